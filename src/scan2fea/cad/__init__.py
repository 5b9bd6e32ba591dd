"""cad (see docs/design.md)."""
