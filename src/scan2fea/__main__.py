"""`python -m scan2fea` is the command `scan2fea`."""

from scan2fea.cli.main import entry

if __name__ == "__main__":
    entry()
