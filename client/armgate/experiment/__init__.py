"""``armgate experiment``: the experiments of the paper with the whole stack, over many leader paths."""
