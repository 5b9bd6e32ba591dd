"""simulation (see docs/design.md)."""
