"""The gait language: rules in, tables out, and stepping them. Nothing is imported here."""
