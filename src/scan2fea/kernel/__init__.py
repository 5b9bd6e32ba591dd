"""kernel (see docs/design.md)."""
