"""``armgate experiment``: the experiments of the paper over many leader paths, in worlds or over sockets."""
