"""The digital calibration certificate: the report's figures as XML by the public schema of the PTB."""
