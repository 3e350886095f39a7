"""Pictures: a plan on one page, a comparison on one page, one storm as several dispatchers met it.

Import from the modules, or from `resilience`; matplotlib is imported when something is drawn.
"""
