"""Which error spoils the tooth most: Morris screening with rank intervals."""
