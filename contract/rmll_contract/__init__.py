"""What trainer, exporter and robot agree on, each thing defined once."""
