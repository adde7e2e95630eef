"""RSI on the wire: the Ethernet file, telegrams, replies, IPOC, Delay and received values."""
