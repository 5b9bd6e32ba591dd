"""viewer (see docs/design.md)."""
