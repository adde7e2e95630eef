"""`armgate rsi`: write the files that a KRC needs, and check a KRC that is only listened to."""
