"""Our thinking: from measured axes to the tooth and back into the controller.

Texts speak the field's terms from the first import on; a site's control changes them when it is opened.
"""

from drivers import registry, terms

terms.speak(registry.first_terms())
