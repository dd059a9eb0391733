"""A scan and what is derived from its points alone: filters, levelling, range view, compact form."""
