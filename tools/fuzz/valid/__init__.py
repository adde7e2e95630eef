"""Fuzzer that sends valid messages only: the daemon must conform to the specification for all of them."""
