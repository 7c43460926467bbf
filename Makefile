# The front door. `make demo` and `make test` do everything, installing what is missing through apt.
JOBS ?= 2
export CTEST_OUTPUT_ON_FAILURE = 1

.PHONY: all build demo evaluate bench bench-serving soak test test-asan test-tsan test-deploy test-node golden fuzz lint format tidy deps clean help

all: build

help:
	@echo "make build      Release binaries in build/release/bin"
	@echo "make demo       build, simulate a robot, close a loop; pictures and timings in out/"
	@echo "make test       build and run all tests"
	@echo "make evaluate   rerun the paper's experiments; EVALUATION.md and plots (half an hour)"
	@echo "make bench      reproduce the figures of PERFORMANCE.md (minutes; GEM_DATA_DIR names the recordings)"
	@echo "make bench-serving  a server under load, measured from outside (minutes; on an idle machine)"
	@echo "make soak       robots, planners, watchers coming and going for MINUTES=10; fails if the server grows"
	@echo "make lint       check formatting, clang-tidy, protobuf style"
	@echo "make format     format all sources"
	@echo "make test-asan  tests under AddressSanitizer and UndefinedBehaviorSanitizer, fuzzer seeds"
	@echo "make fuzz       every fuzzer for SECONDS_EACH=60 seconds, JOBS=2 at a time"
	@echo "make test-tsan  tests under ThreadSanitizer"
	@echo "make test-deploy dashboards, rules and alerts against a loaded server that Prometheus watches"
	@echo "make test-node  a client in Node, from the .proto files and ENCODINGS.md alone, against a server"
	@echo "make golden     write the golden vectors of ENCODINGS.md anew, after a change of what it says"
	@echo "make clean      remove build/ and out/"

deps:
	@deploy/install_dependencies.sh

build/%/build.ninja: | deps
	cmake --preset $*

build: build/release/build.ninja
	cmake --build build/release -j $(JOBS)

demo: build
	deploy/demo.sh build/release/bin out

evaluate: build
	deploy/evaluate.sh build/release/bin

bench: build
	deploy/bench.sh build/release/bin

bench-serving: build
	deploy/bench_serving.sh build/release/bin

MINUTES ?= 10
soak: build
	build/release/bin/gem bench soak --minutes $(MINUTES)

test: build
	cd build/release && ctest

build-clang: build/clang/build.ninja
	cmake --build build/clang -j $(JOBS)

test-asan: build/asan-ubsan/build.ninja
	cmake --build build/asan-ubsan -j $(JOBS)
	ctest --preset asan-ubsan

# Alone, so that CI can build while it runs tests.
FUZZERS = write_seeds fuzz_ingest_request fuzz_tile fuzz_local_map fuzz_map_file fuzz_reader_request fuzz_reader_answer fuzz_mirror \
  fuzz_client_answer fuzz_server_call

fuzz: build/asan-ubsan/build.ninja
	cmake --build build/asan-ubsan -j $(JOBS) --target $(FUZZERS)
	deploy/fuzz.sh build/asan-ubsan

# What has threads of its own (those of emulated kernels too) and no gRPC: stock gRPC is not instrumented, and what it runs would be reported falsely.
TSAN_TESTS = base_test client_watch_test global_test local_threads_test server_core_test emulation_test

test-tsan: build/tsan/build.ninja
	cmake --build build/tsan -j $(JOBS) --target $(TSAN_TESTS)
	ctest --preset tsan

# Debian's own Python, for which apt installs what is needed.
test-deploy: build
	deploy/install_dependencies.sh --deploy
	GEM_BIN=$(CURDIR)/build/release/bin /usr/bin/python3 -B -m unittest discover -s tests/deploy -p '*_test.py'

test-node: build
	deploy/test_node.sh build/release/bin

lint:
	deploy/lint.sh format
	deploy/lint.sh proto
	deploy/lint.sh tidy

tidy: build/clang/build.ninja
	deploy/lint.sh tidy

format:
	deploy/lint.sh fix

golden: build/release/build.ninja
	cmake --build build/release -j $(JOBS) --target write_golden
	build/release/bin/write_golden tests/proto/golden

clean:
	rm -rf build out
