"""Fixtures that the tests of several formats share."""

import pytest

from tests.support.runs.work import InlineWorkers


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vlnpe.pipeline.execution.settings.Workers", InlineWorkers)
