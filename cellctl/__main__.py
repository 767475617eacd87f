"""`python -m cellctl` is `cellctl`."""

from cellctl.cli import main

if __name__ == "__main__":
    main()
