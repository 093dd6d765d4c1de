"""What the flight recorder costs the loop: handing over a tick, at the real pace."""

import time
from contextlib import closing

from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.recorder import Recorder
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.tick_listener import TickListener
from rmll_onboard.settings.runtime_settings import RuntimeSettings

PACE = 0.005
"""[s] between ticks"""


def test_handing_over_a_tick(benchmark, bundle, new_operator, walk, tell, tmp_path) -> None:
    """Once the command is sent, so that none of it comes between state and command."""
    daemon = Daemon(bundle, RuntimeSettings(), new_operator())
    about = describe(bundle, RuntimeSettings(), real_time=True)
    plain, policy = [], []

    def record() -> None:
        with closing(Recorder(tmp_path / "walk.mcap", about, 1000)) as recorder:
            listener = TickListener(daemon, recorder.keep)
            for tick in walk[:2000]:
                time.sleep(PACE)
                answer = daemon.tick(tick.now, tick.datagrams)
                began = time.perf_counter_ns()
                listener.observe(tick.now, tick.datagrams, answer)
                took = (time.perf_counter_ns() - began) / 1000
                (policy if daemon.due else plain).append(took)
        assert recorder.report().dropped == 0

    benchmark.pedantic(record, rounds=1)
    tell("handing over a tick", plain)
    tell("handing over a tick with the inside", policy)
