"""The operator's page in a real browser, before the real service and a simulated cell."""
