"""The operator's side: pre-flight check, contract tools, flights, campaigns, reports."""
