"""The app: scenes are put together, planned, run and looked at in a browser; nothing is only here."""
