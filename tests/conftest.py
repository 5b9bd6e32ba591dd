"""The longest test begins first, so that no worker is left alone with it at the end."""


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.name != "test_the_whole_quick_run")  # stable: all others keep their order
