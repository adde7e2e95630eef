"""``armgate zoom``: changes the wanted view distance as an operator would."""
