"""verification (see docs/design.md)."""
