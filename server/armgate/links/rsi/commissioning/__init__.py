"""`armgate rsi`: write the files that a KRC needs, and check a KRC without answering it."""
