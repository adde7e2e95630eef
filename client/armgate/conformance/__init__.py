"""A black-box kit that tells whether a server keeps the specification of the protocol.

It speaks to any server over the network, with a wire client of its own: neither the SDK nor the code that
reads and writes messages in this project is used, so that a mistake that both sides share does not hide.
"""
