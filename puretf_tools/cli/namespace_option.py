"""The option --namespace."""

import argparse


def add_namespace_option(parser: argparse.ArgumentParser, what: str, *topics: str) -> None:
    """Add `--namespace`; the help says what the command does with the topics (default: TF's)."""
    parser.add_argument('--namespace', default='', metavar='NAME',
                        help=f'{what} ' + ' and '.join(
                            f'/NAME/{topic}' for topic in topics or ('tf', 'tf_static')))
