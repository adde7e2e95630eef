"""The cases, by what of the specification they try. Each module registers its own."""
