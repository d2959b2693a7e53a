"""An adversary inside the contract: what it draws, what it uses, what it leaves of the margins."""
