"""The program `pipeline`, as `cargo build` makes it."""

import os
import signal
import sys
import sysconfig


def main() -> int:
    """Executes the process's command line and returns the exit code."""
    # The program has handlers of its own; where it has none, Ctrl-C ends it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # As the program sets them before its first thread.
    os.environ.setdefault("CANDLE_NUM_THREADS", "1")
    from pipeline._pipeline import main as execute

    executable = os.path.join(sysconfig.get_path("scripts"), "pipeline")
    return execute(executable, ["pipeline", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
