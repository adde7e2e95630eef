"""The cases, by topic of the specification. Each module registers its own."""
