"""``make protocol-mutation``: get packets wrong in the ways that people do, and see it noticed.

Each row of MUTATIONS is applied to a copy of the tree. A test of onboard's own has to fail, and one
of hil's, where the emulated robot judges the runtime with a codec of its own. Prints who noticed,
and fails if a row is not seen on both sides. A word takes the rows that have it: protocol.py MIT
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PROTOCOL = "onboard/rmll_onboard/protocol"
PACKAGES = ("common", "gait_specs", "robots", "contract", "view", "onboard", "hil")
TESTS = {
    "a1": (
        ("tests/onboard/test_a1_packets.py", "tests/onboard/test_a1_remote.py"),
        ("tests/hil/test_both_ends.py", "tests/hil/test_joint_convention.py"),
    ),
    "can": (
        (
            "tests/onboard/test_mit_of_others.py",
            "tests/onboard/test_mit_packets.py",
            "tests/onboard/test_can_frame.py",
        ),
        ("tests/hil/test_can_robot.py",),
    ),
}
"""Of onboard and of hil"""
FAILED = re.compile(r"^(?:FAILED|ERROR) \S*?(test_\w+)\.py(?:::(\w+))?", re.M)


class Mutation(NamedTuple):
    """``old`` is in the file once."""

    what: str
    tests: str
    file: str
    old: str
    new: str


MUTATIONS = (
    Mutation(
        "command: q and dq swapped", "a1", "a1_packets",
        '("q", "<f4"),\n        ("dq", "<f4"),\n        ("tau", "<i2"),\n        ("kp"',
        '("dq", "<f4"),\n        ("q", "<f4"),\n        ("tau", "<i2"),\n        ("kp"',
    ),
    Mutation(
        "command: kp and kd swapped", "a1", "a1_packets",
        '("kp", "<i2"),\n        ("kd", "<i2")', '("kd", "<i2"),\n        ("kp", "<i2")',
    ),
    Mutation(
        "command: kp 64 counts, not 32", "a1", "a1_packets",
        "= 256.0, 32.0, 16.0", "= 256.0, 64.0, 16.0",
    ),
    Mutation(
        "both: torque 128 counts, not 256", "a1", "a1_packets",
        "= 256.0, 32.0, 16.0", "= 128.0, 32.0, 16.0",
    ),
    Mutation(
        "command: motors from the last to the first", "a1", "a1_packets",
        'np.frombuffer(self._packet, LOW_CMD)["motor"][0, :JOINTS]',
        'np.frombuffer(self._packet, LOW_CMD)["motor"][0, JOINTS - 1 :: -1]',
    ),
    Mutation(
        "command: for the high level", "a1", "a1_packets", "LOW_LEVEL = 0xFF", "LOW_LEVEL = 0xEE"
    ),
    Mutation(
        "state: torque with the other sign", "a1", "a1_packets",
        "np.divide(self._tau, TAU_SCALE", "np.divide(self._tau, -TAU_SCALE",
    ),
    Mutation(
        "state: legs FL, FR, RL, RR", "a1", "a1_packets",
        "kept[:] = came",
        "kept[:] = came[[3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]] if len(came) == 12 else came",
    ),
    Mutation(
        "state: quaternion z, y, x, w", "a1", "a1_packets",
        "(state.quaternion, imu[:4])", "(state.quaternion, imu[3::-1])",
    ),
    Mutation(
        "state: gyroscope and accelerometer swapped", "a1", "a1_packets",
        "(state.gyro, imu[4:7]),\n            (state.accelerometer, imu[7:10])",
        "(state.gyro, imu[7:10]),\n            (state.accelerometer, imu[4:7])",
    ),
    Mutation(
        "state: temperature two bytes early", "a1", "a1_packets",
        '("ddq_raw", "<i2"),\n        ("temperature", "i1")',
        '("temperature", "i1"),\n        ("ddq_raw", "<i2")',
    ),
    Mutation(
        "state: the feet's estimate for the feet", "a1", "a1_packets",
        '("foot_force", "<i2", 4),\n        ("foot_force_estimate", "<i2", 4)',
        '("foot_force_estimate", "<i2", 4),\n        ("foot_force", "<i2", 4)',
    ),
    Mutation(
        "both: checksum from 0", "a1", "a1_packets",
        ".translate(_MIRROR)) ^ 0xFFFFFFFF", ".translate(_MIRROR), 0xFFFFFFFF) ^ 0xFFFFFFFF",
    ),
    Mutation(
        "both: checksum one word short", "a1", "a1_packets",
        "(length // 4 - 1) * 4", "(length // 4 - 2) * 4",
    ),
    Mutation(
        "remote: sticks ly and rx swapped", "a1", "a1_remote",
        "buttons, lx, rx, ry, _l2, ly =", "buttons, lx, ly, ry, _l2, rx =",
    ),
    Mutation(
        "remote: buttons A and B swapped", "a1", "a1_remote",
        "    A = auto()\n    B = auto()", "    B = auto()\n    A = auto()",
    ),
    Mutation(
        "MIT command: velocity shifted by a bit", "can", "mit_packets",
        "words << np.uint64(_BITS) |", "words << np.uint64(_BITS - 1) |",
    ),
    Mutation(
        "MIT command: little-endian", "can", "mit_packets", 'astype(">u8")', 'astype("<u8")'
    ),
    Mutation(
        "MIT command: kp and kd swapped", "can", "mit_packets",
        "(commands.kp - ranges.kp / 2, ranges.kp / 2),\n"
        "        (commands.kd - ranges.kd / 2, ranges.kd / 2),",
        "(commands.kd - ranges.kd / 2, ranges.kd / 2),\n"
        "        (commands.kp - ranges.kp / 2, ranges.kp / 2),",
    ),
    Mutation(
        "MIT reply: the other sign", "can", "mit_packets",
        "return steps * (2.0 / top) * end - end", "return end - steps * (2.0 / top) * end",
    ),
    Mutation(
        "MIT reply: velocity and torque swapped", "can", "mit_packets",
        "measured >> _BITS & _TOP, measured & _TOP", "measured & _TOP, measured >> _BITS & _TOP",
    ),
    Mutation(
        "MIT reply: a Damiao's status in the low bits", "can", "mit_packets",
        "status = data[0] >> 4", "status = data[0] & 0x0F",
    ),
    Mutation(
        "MIT: switched off to switch on", "can", "mit_packets",
        'ENTER = b"\\xff" * 7 + b"\\xfc"', 'ENTER = b"\\xff" * 7 + b"\\xfd"',
    ),
    Mutation(
        "IMU: 1000 counts of a rad/s, not 900", "can", "can_imu",
        "32767.0, 900.0", "32767.0, 1000.0",
    ),
    Mutation(
        "IMU: little-endian", "can", "can_imu", 'Struct(">4h")', 'Struct("<4h")'
    ),
    Mutation(
        "frame: bus and length swapped", "can", "can_frame",
        "_FRAME.pack(id_, bus, len(data), data)", "_FRAME.pack(id_, len(data), bus, data)",
    ),
)  # fmt: skip


def copy_tree(folder: Path) -> None:
    """What the tests need; the tests find their packages in it."""
    for name in (*PACKAGES, "policies"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("conftest.py", "onboard", "hil"):
        path = ROOT / "tests" / name
        target = folder / "tests" / name
        target.parent.mkdir(exist_ok=True)
        if path.is_dir():
            shutil.copytree(path, target, ignore=shutil.ignore_patterns("__pycache__", "golden"))
        else:
            shutil.copy(path, target)
    shutil.copy(ROOT / "pyproject.toml", folder)


def noticed(folder: Path, tests: tuple[str, ...]) -> str | None:
    """The first test that fails, None if all pass."""
    command = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    path = os.pathsep.join(str(folder / name) for name in PACKAGES)
    environment = os.environ | {"PYTHONPATH": path, "HYPOTHESIS_PROFILE": "mutation"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode == 0:
        return None
    failed = FAILED.search(done.stdout)
    if done.returncode not in (1, 2) or not failed:
        sys.exit(f"pytest itself failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return failed[2] or failed[1]


def main(words: list[str]) -> None:
    mutations = [each for each in MUTATIONS if all(word in each.what for word in words)]
    survived = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        copy_tree(folder)
        for tests in TESTS.values():
            if failed := noticed(folder, tests[0] + tests[1]):
                sys.exit(f"{failed} fails without any mutation")
        for mutation in mutations:
            path = folder / PROTOCOL / f"{mutation.file}.py"
            source = path.read_text()
            if source.count(mutation.old) != 1:
                sys.exit(f"{mutation.what}: {path.name} is another now, mend the list")
            path.write_text(source.replace(mutation.old, mutation.new))
            found = [noticed(folder, tests) for tests in TESTS[mutation.tests]]
            path.write_text(source)
            print(
                f"{mutation.what:46} onboard: {found[0] or '-'}; hil: {found[1] or '-'}", flush=True
            )
            if None in found:
                survived.append(mutation.what)
    print(f"{len(mutations) - len(survived)} of {len(mutations)} noticed on both sides")
    if survived:
        sys.exit(f"not noticed: {'; '.join(survived)}")


if __name__ == "__main__":
    main(sys.argv[1:])
