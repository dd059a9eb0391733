from tests.client.answer_server import server

__all__ = ["server"]
