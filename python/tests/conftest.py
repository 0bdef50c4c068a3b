"""What tests share. Expensive results are made once."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

import carpus

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "fixtures" / "demo_study"


@pytest.fixture(scope="session")
def session() -> carpus.Session:
    return carpus.demo().load()


@pytest.fixture(scope="session")
def fit(session: carpus.Session) -> carpus.Personalization:
    return session.personalize()


@pytest.fixture(scope="session")
def diagnosis(session: carpus.Session) -> carpus.Diagnosis:
    return session.diagnose()


@pytest.fixture(scope="session")
def opensim():
    """OpenSim's own API; tests that want it are skipped where it is not installed."""
    module = pytest.importorskip("opensim", reason="OpenSim's Python package is not installed")
    module.Logger.setLevelString("off")
    return module


@pytest.fixture(autouse=True)
def quiet() -> None:
    carpus.show_progress(False)
    # Programs that run in the background of a shell ignore Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def lab_models() -> Path:
    folder = Path(os.environ.get("CARPUS_SHARED", ROOT.parent / "shared"))
    if not folder.is_dir():
        pytest.skip(f"lab models are not at {folder}")
    return folder
