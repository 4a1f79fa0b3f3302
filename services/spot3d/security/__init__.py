"""Who may take part in the dataflow, and in what role: certificates and access control."""
