"""What is handed out: built, installed elsewhere and started; run by `make package` and `make bundle`."""
