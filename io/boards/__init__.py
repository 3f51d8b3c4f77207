"""The boards: their protocol, their ports, the process that reads them, the recorder."""
