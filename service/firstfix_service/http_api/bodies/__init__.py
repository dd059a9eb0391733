"""Request bodies: JSON, forms, uploads in parts, each within its limits."""
