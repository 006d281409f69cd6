# SPDX-License-Identifier: GPL-3.0-or-later
"""Dermis: skin weights of one character for another.

Nothing is imported at the top, so that the bpy-free half (`core`) can be imported alone, and so
that a missing native module leads to a panel that says so instead of a traceback.
"""


def register() -> None:
    """Register the whole add-on, or only a panel with the reason why that is impossible."""
    from .core.native import native_problem

    problem = native_problem()
    if problem:
        from .ui import missing_native

        missing_native.register(problem)
    else:
        from .ui import registration

        registration.register()


def unregister() -> None:
    """Take back what `register` did."""
    from .ui import missing_native

    if missing_native.is_registered():
        missing_native.unregister()
    else:
        from .ui import registration

        registration.unregister()
