"""The measures: each file answers one question and holds ``registration = Measure(...)``."""
