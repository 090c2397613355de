"""What the gateway may ask of the outside world: one Protocol for each role a device can play."""
