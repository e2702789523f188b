"""`grasptransfer mcp`: tools of the Model Context Protocol in front of a running service."""

from grasptransfer.service.mcp_bridge import BridgeSettings, serve_bridge


def mcp(settings: BridgeSettings) -> int:
    """Offer a running service to language models: tools health, metadata and infer, over standard input."""
    serve_bridge(settings)
    return 0
