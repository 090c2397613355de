"""Commands for who answers for the control: doctor, trust, approve, rollback, disable, verify-table, audit."""
