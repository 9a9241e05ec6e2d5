"""`labctl` on the command line, and `python -m labctl`."""

import signal
import sys

from labctl.cli.main import run


def main() -> None:
    """Run the command line and leave with its exit code."""
    code = 130
    try:
        code = run(sys.argv[1:])
        # A Ctrl-C while Python ends would only add its traceback.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except KeyboardInterrupt:
        # Everything is closed already: this cut off the last lines only.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


if __name__ == "__main__":
    main()
