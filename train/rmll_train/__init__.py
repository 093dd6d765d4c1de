"""Training, on a machine that also does other things."""

import os

# OpenMP's threads spin while they wait for each other. Beside any other busy program that made
# training ten times slower; sleeping costs nothing measurable on an idle machine.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
