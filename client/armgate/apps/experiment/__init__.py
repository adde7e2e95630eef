"""``armgate experiment``: the experiments of the paper, through the whole stack, over many leader paths."""
