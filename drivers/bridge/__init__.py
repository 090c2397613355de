"""The instrument bridge: JSON-RPC 2.0 lines to instruments whose own wire is not public."""
