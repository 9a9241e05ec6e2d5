import subprocess
import sys
import time

import pytest

HEAVY = ("numpy", "scipy", "numba", "pydantic", "pint", "pymodbus", "serial", "sim")


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from labctl.cli.main import run; run(['--help']); "
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)

    assert done.returncode == 0
    assert done.stderr.strip() == "[]"


@pytest.mark.real_time
def test_help_answers_in_under_0_3_s():
    def took_s():
        start_s = time.perf_counter()
        subprocess.run([sys.executable, "-m", "labctl", "--help"], capture_output=True, check=True)
        return time.perf_counter() - start_s

    # Beside other programs it takes as long as they let it: one undisturbed run shows what it takes by itself.
    assert any(took_s() < 0.3 for _ in range(50))


def test_every_command_has_help_of_its_own():
    from click.testing import CliRunner

    from labctl.cli.main import COMMANDS, labctl

    for name in COMMANDS:
        shown = CliRunner().invoke(labctl, [name, "--help"])
        assert shown.exit_code == 0, shown.output
        assert "Usage:" in shown.output
