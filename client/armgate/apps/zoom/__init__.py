"""``armgate zoom``: change the wanted view distance as an operator would."""
