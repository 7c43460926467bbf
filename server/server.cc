#include "server/server.h"

#include <google/protobuf/stubs/logging.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "server/call_guard.h"
#include "server/encoded_cache.h"
#include "server/ingest_service.h"
#include "server/live_collector.h"
#include "server/map_service.h"
#include "server/metrics.h"
#include "server/metrics_page.h"
#include "server/process_collector.h"
#include "server/registry.h"
#include "server/terrain_service.h"
#include "server/tile_service.h"
#include "server/turn_scheduler.h"
#include "server/workers.h"
#include "spdlog/spdlog.h"

namespace gem {
namespace {

/// Streams have been told by then; what is still open is cut off.
constexpr std::chrono::milliseconds kShutdownGrace(1000);

// A robot whose radio link died is noticed after 40 s at most.
constexpr int kKeepaliveTime_ms = 30'000;
constexpr int kKeepaliveTimeout_ms = 10'000;
/// Clients may ping this often without being sent away.
constexpr int kClientPing_ms_min = 5'000;

std::string WithPort(const std::string& address, int port) {
  return absl::StrCat(address.substr(0, address.rfind(':')), ":", port);
}

absl::Status CheckAddress(const char* option, const std::string& address) {
  const std::size_t colon = address.rfind(':');
  if (colon != std::string::npos && colon > 0 && colon + 1 < address.size())
    return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(option, " is \"", address, "\", want ADDR:PORT"));
}

absl::Status CannotListen(const char* option, const std::string& address, absl::string_view why) {
  return absl::UnavailableError(
      absl::StrCat(option, " is ", address, ", ", why, ", want a free address of this machine"));
}

std::uint64_t EpochNow() {
  // Another start, another epoch: without storage the history is lost.
  return static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch() /
                                    std::chrono::nanoseconds(1));
}

}  // namespace

struct Server::Impl {
  explicit Impl(const ServerOptions& server_options)
      : options(server_options),
        workers(options),
        readers(workers.reads, options.readers_max, options.worker_threads),
        tile_cache(options.tile_cache_bytes_max),
        registry(options, EpochNow(), metrics, &readers),
        guard(workers.reads),
        correction_guard(workers.corrections),
        ingest_service(registry, options, metrics, correction_guard),
        tile_service(registry, tile_cache, readers, metrics, guard),
        map_service(registry, options, readers, metrics, guard, workers.admin),
        terrain_service(registry, metrics, guard),
        live_collector(std::make_shared<LiveCollector>(registry, readers, tile_cache)),
        process_collector(std::make_shared<ProcessCollector>()) {}

  absl::Status ListenForMetrics() {
    absl::StatusOr<std::unique_ptr<MetricsPage>> page = MetricsPage::Start(options.metrics_listen);
    if (!page.ok())
      return CannotListen("metrics_listen", options.metrics_listen, page.status().message());
    metrics_page = *std::move(page);
    metrics_page->Show(metrics.registry());
    metrics_page->Show(live_collector);
    metrics_page->Show(process_collector);
    metrics_address = WithPort(options.metrics_listen, metrics_page->port());
    return absl::OkStatus();
  }

  absl::Status ListenForCalls() {
    // Protobuf writes a line for every string that is not UTF-8: anybody could fill the log.
    google::protobuf::SetLogHandler(nullptr);
    grpc::EnableDefaultHealthCheckService(true);
    if (options.reflection) grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort(options.listen, grpc::InsecureServerCredentials(), &port);
    // Otherwise a second server silently shares the port.
    builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
    builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, options.streams_per_connection_max);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTime_ms);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeout_ms);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS,
                               kClientPing_ms_min);
    builder.SetMaxReceiveMessageSize(static_cast<int>(options.message_bytes_max));
    builder.SetMaxSendMessageSize(static_cast<int>(options.message_bytes_max));
    builder.RegisterService(&ingest_service);
    builder.RegisterService(&tile_service);
    builder.RegisterService(&map_service);
    builder.RegisterService(&terrain_service);
    server = builder.BuildAndStart();
    if (server == nullptr || port == 0)
      return CannotListen("listen", options.listen, "which is taken or not this machine's");
    grpc_address = WithPort(options.listen, port);
    return absl::OkStatus();
  }

  void Stop() {
    if (server == nullptr) return;
    if (grpc::HealthCheckServiceInterface* health = server->GetHealthCheckService())
      health->Shutdown();
    // Shutdown() does not tell reactors: they are finished first, or it would wait for its
    // deadline.
    ingest_service.DrainAll();
    readers.Stop();
    registry.Stop();
    server->Shutdown(std::chrono::system_clock::now() + kShutdownGrace);
    server->Wait();
    server.reset();
    workers.Stop();
    metrics_page.reset();
  }

  // Constant after construction.
  const ServerOptions options;
  std::string grpc_address;
  std::string metrics_address;

  // Destroyed from the last to the first: nobody refers to what is gone.
  Metrics metrics;
  Workers workers;
  TurnScheduler readers;
  EncodedCache tile_cache;
  Registry registry;
  CallGuard guard;
  CallGuard correction_guard;
  IngestService ingest_service;
  TileService tile_service;
  MapService map_service;
  TerrainService terrain_service;
  std::shared_ptr<LiveCollector> live_collector;
  std::shared_ptr<ProcessCollector> process_collector;
  std::unique_ptr<MetricsPage> metrics_page;
  std::unique_ptr<grpc::Server> server;
};

namespace {

ServerOptions WithBackendOfThisMachine(ServerOptions options) {
  const BackendChoice choice = ChooseLocalBackend(options.backend);
  if (!choice.why_not_cuda.empty()) {
    // Who asked for the device by name will want to know.
    spdlog::log(options.backend == LocalBackend::kCuda ? spdlog::level::warn : spdlog::level::info,
                "local mapper on the {} backend: {}", std::string(NameOf(choice.backend)),
                choice.why_not_cuda);
  }
  options.backend = choice.backend;
  return options;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options) {
  GEM_RETURN_IF_ERROR(Validate(options));
  GEM_RETURN_IF_ERROR(CheckAddress("listen", options.listen));
  GEM_RETURN_IF_ERROR(CheckAddress("metrics_listen", options.metrics_listen));
  auto impl = std::make_unique<Impl>(WithBackendOfThisMachine(options));
  GEM_RETURN_IF_ERROR(impl->ListenForMetrics());
  GEM_RETURN_IF_ERROR(impl->ListenForCalls());
  return std::unique_ptr<Server>(new Server(std::move(impl)));
}

Server::Server(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Server::~Server() { Stop(); }

const std::string& Server::grpc_address() const { return impl_->grpc_address; }
const std::string& Server::metrics_address() const { return impl_->metrics_address; }
Workers& Server::workers() { return impl_->workers; }
void Server::Stop() { impl_->Stop(); }

}  // namespace gem
