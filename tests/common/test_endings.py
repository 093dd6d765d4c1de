"""How commands end when the system refuses something."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rmll_common.command_line import said
from rmll_common.errors import InputError
from rmll_common.output_file import output_file


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (IsADirectoryError(errno.EISDIR, "Is a directory", "here"), "here: Is a directory"),
        (OSError(errno.EXDEV, "Other device", "a", None, "b"), "a to b: Other device"),
        (OSError(errno.ENETUNREACH, "Network is unreachable"), "Network is unreachable"),
        (OSError("AF_UNIX path too long"), "AF_UNIX path too long"),
        (FileNotFoundError(errno.ENOENT, "No such file", b"raw"), "b'raw': No such file"),
    ],
)
def test_the_system_is_quoted_without_its_numbers(error, words):
    assert said(error) == words


def command(code: str, cwd: Path, **pipes) -> subprocess.Popen[str]:
    program = (
        f"from rmll_common.command_line import run\ndef work():\n    {code}\nrun('rmll-x', work)"
    )
    return subprocess.Popen([sys.executable, "-c", program], text=True, cwd=cwd, **pipes)


def test_a_file_that_the_system_refuses_is_named(tmp_path):
    for code in ("open('.', 'w')", "import os; os.rename('none', 'other')"):
        with command(code, tmp_path, stderr=subprocess.PIPE) as process:
            _, told = process.communicate()
        assert process.returncode == 1
        assert told.startswith("rmll-x: ") and told.count("\n") == 1
        assert "Errno" not in told
    assert told == "rmll-x: none to other: No such file or directory\n"


@pytest.mark.parametrize("code", ["print('x' * 200_000)", "print('x')"])
def test_nobody_reading_is_no_complaint(tmp_path, code):
    reading, writing = os.pipe()
    os.close(reading)
    with command(code, tmp_path, stdout=writing, stderr=subprocess.PIPE) as process:
        os.close(writing)
        _, told = process.communicate()
    assert (process.returncode, told) == (141, "")


@pytest.mark.parametrize(("closed", "printed"), [(">&-", ""), ("2>&-", "x\n")])
def test_a_closed_output_is_no_complaint(tmp_path, closed, printed):
    work = "def work(): print('x'); print('y', file=sys.stderr)"
    program = f"import sys\nfrom rmll_common.command_line import run\n{work}\nrun('rmll-x', work)"
    shell = ["sh", "-c", f'exec "$0" -c "$1" {closed}', sys.executable, program]
    ended = subprocess.run(shell, cwd=tmp_path, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (0, printed)
    assert "Traceback" not in ended.stderr


def test_letters_that_the_output_does_not_have_are_replaced(tmp_path):
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    for code, printed in ((r"print('F \u25cf')", "F ?\n"), (r"print('\udcff.yml')", "?.yml\n")):
        with command(code, tmp_path, stdout=subprocess.PIPE, env=ascii_only) as process:
            told, _ = process.communicate()
        assert (process.returncode, told) == (0, printed)


def test_ctrl_c_while_a_command_loads_its_libraries_is_no_traceback(tmp_path):
    # a shell's job in the background inherits that Ctrl-C is ignored
    heeding = "signal.signal(signal.SIGINT, signal.default_int_handler)"
    interrupt = f"import os, signal\n{heeding}\nos.kill(os.getpid(), signal.SIGINT)\n"
    (tmp_path / "slow.py").write_text(interrupt)
    program = "from rmll_common.entry_points import _start; _start('rmll-x', 'slow', 'x')"
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (130, "rmll-x: stopped\n")


def test_another_broken_pipe_is_a_complaint(tmp_path):
    code = "import os; r, w = os.pipe(); os.close(r); os.write(w, b'x')"
    with command(code, tmp_path, stderr=subprocess.PIPE) as process:
        _, told = process.communicate()
    assert (process.returncode, told) == (1, "rmll-x: Broken pipe\n")


def test_a_file_to_write_is_checked_by_its_name_and_folder(tmp_path):
    assert output_file("--out", tmp_path, "../grid.png", ".png") == tmp_path / "grid.png"
    assert output_file("--out", tmp_path / "A.PNG", "grid.png", ".png") == tmp_path / "A.PNG"
    assert output_file("--card", tmp_path / "card", "trot.md") == tmp_path / "card"
    (tmp_path / "grid.png").mkdir()
    for wanted, complaint in (
        (tmp_path / "x.jpg", r"--out .*x\.jpg: expected a \.png file in a folder that exists"),
        (tmp_path / "no" / "x.png", r"--out .*no/x\.png: expected a \.png file in a folder"),
        (tmp_path, r"--out .*: .*/grid\.png is a folder"),
    ):
        with pytest.raises(InputError, match=complaint):
            output_file("--out", wanted, "grid.png", ".png")
