"""Properties are tested without a watch: a busy machine is no failure."""

import os

from hypothesis import HealthCheck, Phase, settings

patient = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("patient", patient)
settings.register_profile("fuzz", patient, max_examples=3000)
# that it fails is all that tests/mutation/protocol.py asks, not the simplest example
settings.register_profile(
    "mutation", patient, max_examples=20, phases=[Phase.explicit, Phase.generate]
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "patient"))
