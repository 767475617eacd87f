"""How a part is divided and oriented before it is cut into layers."""
