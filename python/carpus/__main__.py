"""The program ``carpus``: ``python -m carpus``, and the script that the package installs."""

from __future__ import annotations

import signal
import sys

from . import _carpus


def main() -> None:
    """Runs a command and exits with its code: 0 done, 1 the input is at fault, 2 carpus is at fault."""
    # The interpreter would only note Ctrl-C until the command has ended.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_carpus.program(["carpus", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
