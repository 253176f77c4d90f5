"""Terminal output of the commands: `run`, `diagnosis` and `effects`, through one `console`."""
