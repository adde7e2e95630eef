"""Black-box test kit for servers: it checks that a server conforms to the specification of the protocol.

It connects to any server over the network, with a client of its own. It uses neither the SDK nor this
project's code that encodes and decodes messages, so that an error in that code does not go undetected.
"""
