"""The SINUMERIK 840D in our words: names, tables, programs and the OPC UA road."""
