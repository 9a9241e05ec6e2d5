"""`labctl` on the command line, and `python -m labctl`."""

import sys

from labctl.cli.main import run


def main() -> None:
    """Run the command line and leave with its exit code."""
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
