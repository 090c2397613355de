"""Commands for who keeps the service: serve sites, install it into the system's service manager."""
