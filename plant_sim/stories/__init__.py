"""Stories: operator actions and faults on the twin whose outcome with a changed program is compared with the original."""
