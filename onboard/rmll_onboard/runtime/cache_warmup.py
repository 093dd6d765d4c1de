"""A daemon that nobody hears: it goes through a policy tick shortly before the real one does.

In the 20 ms since the last policy tick most of its code and the network's weights have left the
processor's caches, and without them it takes more than twice as long. The cache warmer brings them
back: the same code on the same datagrams, with a state of its own, and no effect.
"""

import dataclasses
from collections.abc import Sequence

import msgspec

from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import Bundle
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.modes import Mode

_CALM = {"torque_error": 100.0, "stale_ms": 1000.0, "missed_ticks": 400, "stuck": 100.0}
"""Safety settings: no motor obeys a cache warmer, and it only plays while a robot walks,
also to its stop"""


def cache_warmer(bundle: Bundle, settings: RuntimeSettings) -> "CacheWarmer | None":
    """None where the settings want none."""
    return CacheWarmer(bundle, settings) if settings.realtime.cache_warmup_us else None


class CacheWarmer(Daemon):
    """Ticks at the policy's rate, and always walks."""

    def __init__(self, bundle: Bundle, settings: RuntimeSettings) -> None:
        ranges = bundle.table.commands
        contract = msgspec.structs.replace(bundle.contract, control_hz=bundle.contract.policy_hz)
        safety = msgspec.structs.replace(settings.safety, **_CALM)
        super().__init__(
            dataclasses.replace(bundle, contract=contract),
            msgspec.structs.replace(settings, safety=safety),
            FlagOperator(ranges, ranges.vx[0], ranges.wz[0], ranges.frequency[0]),
        )

    def warm_up(self, now: int, datagrams: Sequence[bytes]) -> None:
        """Go through a policy tick with what came since the last one."""
        supervisor = self._supervisor
        supervisor.mode, supervisor.fault = Mode.WALKING, None
        self.tick(now, datagrams)
