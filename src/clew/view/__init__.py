"""Pictures of results; draws and computes nothing."""
