"""Policies of tests are judged by few robots, for a second: it is the words that are tested."""

import pytest

from rmll_train import periodic_evaluation


@pytest.fixture(autouse=True)
def quick_judge(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(periodic_evaluation, "ROBOTS", 8)
    monkeypatch.setattr(periodic_evaluation, "SECONDS", 1.0)
