"""repair (see docs/design.md)."""
