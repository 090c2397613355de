"""All errors of a machine: set-up by set-up through the site's plan, from captures to one error model."""
