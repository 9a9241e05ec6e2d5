import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.real_time

HEAVY = ("numpy", "scipy", "numba", "pydantic", "pint", "pymodbus", "serial", "sim")


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from labctl.cli.main import run; run(['--help']); "
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)

    assert done.returncode == 0
    assert done.stderr.strip() == "[]"


def test_help_answers_in_under_0_3_s():
    times_s = []
    for _ in range(5):
        start_s = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "labctl", "--help"], capture_output=True, timeout=30, check=True
        )
        times_s.append(time.perf_counter() - start_s)

    assert min(times_s) < 0.3


def test_every_command_has_help_of_its_own():
    from click.testing import CliRunner

    from labctl.cli.main import COMMANDS, labctl

    for name in COMMANDS:
        shown = CliRunner().invoke(labctl, [name, "--help"])
        assert shown.exit_code == 0, shown.output
        assert "Usage:" in shown.output
