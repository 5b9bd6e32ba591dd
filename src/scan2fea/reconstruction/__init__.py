"""reconstruction (see docs/design.md)."""
