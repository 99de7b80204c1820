#!/bin/sh
# Regenerates recorder/storage/recorder_pb2.py and .pyi from recorder.proto.
# Generated with protoc 29, so that every protobuf runtime from 5.29 on accepts the result;
# a throw-away environment keeps that old compiler out of the project's own.
set -eu
cd "$(dirname "$0")/../recorder/storage"
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
python3 -m venv "$tools"
"$tools/bin/pip" -q install 'grpcio-tools==1.71.*' 'mypy-protobuf==3.7.*' 'setuptools<81'
PATH="$tools/bin:$PATH" "$tools/bin/python" -m grpc_tools.protoc -I. --python_out=. --mypy_out=. recorder.proto
