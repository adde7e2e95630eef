"""One cell in one process: commands to the gate, leases, stops, signals and states, without sockets and clocks."""
