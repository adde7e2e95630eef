"""Errors of environments: wrong use, with what was expected."""


class EnvError(ValueError):
    """Environment that cannot be made or reset as requested."""


class ActionError(ValueError):
    """Action that is not an array of finite numbers of the right shape; the world has not been stepped."""
