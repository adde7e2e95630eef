"""Virtual KRC as a process: options, console, real-time cycle, UDP socket and simulated network."""
