"""An 840D that no wire reaches: the programs of the road by OPC UA, carried there and back as files.

The controller here is that of `drivers.sinumerik.opcua` over a session that lives in a folder: what is written to R
parameters goes along in the next program, and what is read comes from the report that each program writes. Called by
the registry alone; knows the rooms of the 840D, nobody of them knows it.
"""
