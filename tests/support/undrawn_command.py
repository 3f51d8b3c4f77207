"""The command `tensegraph`, whose figures are files without content: `python undrawn_command.py ...`."""

from blank_figures import blank_figures
from tensegraph.cli import main

if __name__ == "__main__":
    with blank_figures():
        main()
