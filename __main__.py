"""`python -m tensegraph`."""

from .cli import main

if __name__ == "__main__":
    main()
