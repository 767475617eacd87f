"""The cell in the words of the shop's own standards: MTConnect and OPC UA. Clients of the service, read only, each a process of its own."""
