"""The command `tensegraph`, whose figures are files without content: `python undrawn_command.py ...`."""

if __name__ == "__main__":  # the processes that it starts need nothing of it
    from blank_figures import no_figures
    from tensegraph.cli import main

    with no_figures():
        main()
