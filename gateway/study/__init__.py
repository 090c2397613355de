"""The paper's studies of one gear on one machine: what each error does, which matters, what correction will bring."""
