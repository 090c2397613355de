"""attocube IDS3010 interferometers: JSON-RPC 2.0 over TCP port 9090, one object a line, asked sample by sample."""
