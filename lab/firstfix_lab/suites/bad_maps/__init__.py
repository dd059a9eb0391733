"""Good maps and bad ones made of them: what the map's check finds, and what the gate of builds holds back."""
