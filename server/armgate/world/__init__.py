"""One cell in one process: requests, gate, leases, stops, signals and states, without sockets and clocks."""
