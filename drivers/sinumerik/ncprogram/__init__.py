"""The NC programs that we send: measuring, loading a table, switching it off, grinding a part.

Pure: records to text. Only the OPC UA road calls it. No program starts by itself, and each looks at the abort word.
"""
