"""One cell without sockets and clocks: commands to the gate, leases, stops, signals and states."""
