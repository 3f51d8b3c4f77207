"""`python -m tensegraph`, and the command `tensegraph`."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while the libraries are imported."""
    try:
        from .cli import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
