"""Our thinking: from measured axes to the tooth and back into the controller."""
