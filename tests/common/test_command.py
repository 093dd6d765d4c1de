"""What all commands share, each as a process."""

import subprocess
import sys
from importlib.metadata import version

import pytest

MODULES = {
    "rmll-gait": "rmll_view.gait_cli",
    "rmll-train": "rmll_train.cli",
    "rmll-export": "rmll_export.cli",
    "rmll-onboard": "rmll_onboard.cli",
    "rmll-hil": "rmll_hil.cli",
    "rmll-eval": "rmll_eval.cli",
}


def command(name: str, *words: str) -> subprocess.CompletedProcess[str]:
    start = f"from {MODULES[name]} import main; main()"
    words = (sys.executable, "-c", start, *words)
    return subprocess.run(words, capture_output=True, text=True, timeout=240)


@pytest.mark.parametrize("name", MODULES)
def test_every_command_tells_its_version(name: str) -> None:
    done = command(name, "--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{name} {version('rmll')}\n", "")


def test_a_shell_completes_what_the_readme_says(tmp_path) -> None:
    script = tmp_path / "rmll-hil"
    script.write_text(command("rmll-hil", "--tyro-print-completion", "bash").stdout)
    ask = f"source {script}; COMP_WORDS=(rmll-hil run --lo); COMP_CWORD=2; _tyro_rmll_hil; "
    done = subprocess.run(["bash", "-c", ask + "echo $COMPREPLY"], capture_output=True, text=True)
    assert done.stdout == "--lockstep\n", done.stderr
