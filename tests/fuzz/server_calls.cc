#include "tests/fuzz/server_calls.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/stubs/logging.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdio>
#include <memory>
#include <string_view>

#include "core/base/check.h"
#include "gem/v1/ingest_service.grpc.pb.h"
#include "gem/v1/map_service.grpc.pb.h"
#include "gem/v1/terrain_service.grpc.pb.h"
#include "gem/v1/tile_service.grpc.pb.h"
#include "proto/wire/pose.h"
#include "proto/wire/scan.h"
#include "server/server.h"
#include "tests/fuzz/framed_messages.h"

namespace gem::fuzz {
namespace {

using google::protobuf::Message;
using google::protobuf::MessageFactory;
using google::protobuf::MethodDescriptor;

/// After so many calls a fresh server: what one input leaves behind must not decide about a later
/// one for ever.
constexpr int kCallsOfServer_max = 1000;
/// A stream that goes on by itself is left after so many answers, or when none comes.
constexpr int kAnswersMax = 8;
constexpr std::chrono::milliseconds kStreamPatience(20);
constexpr std::chrono::seconds kPatience(30);

const std::vector<const MethodDescriptor*>& Methods() {
  static const std::vector<const MethodDescriptor*> methods = [] {
    std::vector<const MethodDescriptor*> found;
    for (const char* name :
         {v1::IngestService::service_full_name(), v1::MapService::service_full_name(),
          v1::TerrainService::service_full_name(), v1::TileService::service_full_name()}) {
      const auto* service =
          google::protobuf::DescriptorPool::generated_pool()->FindServiceByName(name);
      GEM_CHECK(service != nullptr);
      for (int i = 0; i < service->method_count(); ++i) found.push_back(service->method(i));
    }
    return found;
  }();
  return methods;
}

ServerOptions SmallServer() {
  ServerOptions options;
  options.listen = options.metrics_listen = "127.0.0.1:0";
  options.log_level = "error";
  options.publish_hz = 100;
  options.map.cell_size_m = 0.5f;
  options.local_map.side_m = 4;
  options.session_idle_s_max = 0.05;
  options.pose_wait_s_max = 0.01;
  options.sessions_max = options.maps_max = options.ended_sessions_max = 8;
  options.scan_bytes_max = 4096;
  options.points_max = 256;
  options.queue_bytes_max = 1 << 16;
  options.message_bytes_max = 1 << 20;
  return options;
}

grpc::ByteBuffer ToBuffer(std::string_view bytes) {
  const grpc::Slice slice(bytes.data(), bytes.size());
  return {&slice, 1};
}

v1::IngestRequest OpenMessage() {
  v1::IngestRequest request;
  request.mutable_open()->set_map("site");
  request.mutable_open()->set_robot("robot");
  request.mutable_open()->set_session("session");
  request.mutable_open()->add_sensors()->set_name("top");
  wire::ToProto(Pose<Base, Sensor>(),
                request.mutable_open()->mutable_sensors(0)->mutable_base_from_sensor());
  return request;
}

v1::IngestRequest ScanMessage() {
  v1::IngestRequest request;
  v1::Scan& scan = *request.mutable_scan();
  scan.set_seq(1);
  scan.set_stamp_ns(100);
  scan.set_sensor("top");
  wire::ToProto(Pose<Odom, Base>::FromTranslation(0, 0, 1), scan.mutable_odom_from_base());
  const std::vector<ScanPoint> points = {
      {0.6f, 0.1f, -1, 0xff0000ff}, {-0.7f, 0.2f, -0.5f, 0}, {0.1f, 0.9f, -1, 0xff00ff00}};
  wire::PointsToProto(points, &scan);
  return request;
}

v1::IngestRequest CloseMessage() {
  v1::IngestRequest request;
  request.mutable_close();
  return request;
}

/// A server with one small map, and a way to call it that knows only bytes.
class FuzzedServer {
 public:
  FuzzedServer() {
    auto server = Server::Start(SmallServer());
    if (!server.ok()) std::fprintf(stderr, "%s\n", server.status().ToString().c_str());
    GEM_CHECK(server.ok());
    server_ = *std::move(server);
    spdlog::set_level(spdlog::level::off);
    stub_ = std::make_unique<grpc::GenericStub>(
        grpc::CreateChannel(server_->grpc_address(), grpc::InsecureChannelCredentials()));
    const MethodDescriptor* ingest =
        google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(
            "gem.v1.IngestService.Ingest");
    GEM_CHECK(ingest != nullptr);
    const std::string open = OpenMessage().SerializeAsString(),
                      scan = ScanMessage().SerializeAsString(),
                      close = CloseMessage().SerializeAsString();
    GEM_CHECK(Stream(*ingest, {open, scan, close}).ok());
  }

  grpc::Status Call(const MethodDescriptor& method, const std::vector<std::string_view>& messages) {
    if (method.client_streaming() || method.server_streaming()) return Stream(method, messages);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    grpc::CompletionQueue queue;
    grpc::ByteBuffer response;
    grpc::Status status;
    const auto call =
        stub_->PrepareUnaryCall(&context, PathOf(method), ToBuffer(messages.front()), &queue);
    call->StartCall();
    call->Finish(&response, &status, nullptr);
    WaitFor(queue);
    return status;
  }

 private:
  static std::string PathOf(const MethodDescriptor& method) {
    return "/" + method.service()->full_name() + "/" + method.name();
  }

  static bool WaitFor(grpc::CompletionQueue& queue) {
    void* tag = nullptr;
    bool ok = false;
    GEM_CHECK(queue.Next(&tag, &ok));
    return ok;
  }

  grpc::Status Stream(const MethodDescriptor& method,
                      const std::vector<std::string_view>& messages) {
    grpc::ClientContext context;
    // Ingest and import come to an end by themselves; what is watched does not.
    const bool endless = method.server_streaming() && !method.client_streaming();
    context.set_deadline(std::chrono::system_clock::now() +
                         (endless ? std::chrono::nanoseconds(kStreamPatience)
                                  : std::chrono::nanoseconds(kPatience)));
    grpc::CompletionQueue queue;
    const auto call = stub_->PrepareCall(&context, PathOf(method), &queue);
    call->StartCall(nullptr);
    bool open = WaitFor(queue);
    for (const std::string_view message : messages) {
      if (!open) break;
      call->Write(ToBuffer(message), nullptr);
      open = WaitFor(queue);
      if (!method.client_streaming()) break;
    }
    if (open) {
      call->WritesDone(nullptr);
      WaitFor(queue);
    }
    grpc::ByteBuffer response;
    for (int i = 0;; ++i) {
      if (endless && i == kAnswersMax) context.TryCancel();
      call->Read(&response, nullptr);
      if (!WaitFor(queue)) break;
    }
    grpc::Status status;
    call->Finish(&status, nullptr);
    WaitFor(queue);
    return status;
  }

  std::unique_ptr<Server> server_;
  std::unique_ptr<grpc::GenericStub> stub_;
};

FuzzedServer& TheServer() {
  static std::unique_ptr<FuzzedServer> server;
  static int num_calls = 0;
  if (server == nullptr || ++num_calls > kCallsOfServer_max) {
    server.reset();
    server = std::make_unique<FuzzedServer>();
    num_calls = 0;
  }
  return *server;
}

std::string Seed(const std::string& method, const std::vector<std::string>& messages) {
  const auto& methods = Methods();
  std::string seed;
  for (std::size_t i = 0; i < methods.size(); ++i)
    if (methods[i]->name() == method) seed += static_cast<char>(i);
  GEM_CHECK(seed.size() == 1);
  return seed + Frame(messages);
}

/// Fields that are called alike mean the same in every request.
void FillIn(Message& message) {
  const auto* reflection = message.GetReflection();
  const auto* descriptor = message.GetDescriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const auto* field = descriptor->field(i);
    const std::string& name = field->name();
    if (name == "map" && field->cpp_type() == field->CPPTYPE_STRING)
      reflection->SetString(&message, field, "site");
    if (name == "robot") reflection->SetString(&message, field, "robot");
    if (name == "session") reflection->SetString(&message, field, "session");
    if (name == "tiles" || name == "points" || name == "path") {
      if (field->cpp_type() == field->CPPTYPE_MESSAGE && field->is_repeated())
        reflection->AddMessage(&message, field);
    }
    if (name == "poses" && field->message_type() == v1::GlobalPose::descriptor()) {
      auto* pose = static_cast<v1::GlobalPose*>(reflection->AddMessage(&message, field));
      pose->set_stamp_ns(100);
      wire::ToProto(Pose<Global, Base>::FromTranslation(1, 0, 0), pose->mutable_map_from_base());
    }
    if (name == "footprint") {
      auto* footprint = static_cast<v1::Footprint*>(reflection->MutableMessage(&message, field));
      footprint->set_radius_m(0.5);
    }
  }
}

}  // namespace

void ServerCall(const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);
  if (size == 0) return;
  const MethodDescriptor& method = *Methods()[data[0] % Methods().size()];
  const std::vector<std::string_view> messages =
      FramedMessages({reinterpret_cast<const char*>(data) + 1, size - 1});
  // What is no message at all is gRPC's to refuse, with a code that ours must not have.
  const Message* prototype = MessageFactory::generated_factory()->GetPrototype(method.input_type());
  const std::unique_ptr<Message> parsed(prototype->New());
  for (const std::string_view message : messages)
    if (!parsed->ParseFromArray(message.data(), static_cast<int>(message.size()))) return;
  const grpc::Status status = TheServer().Call(method, messages);
  GEM_CHECK(status.error_code() != grpc::StatusCode::INTERNAL);
  GEM_CHECK(status.error_code() != grpc::StatusCode::UNKNOWN);
}

std::vector<std::string> ServerCallSeeds() {
  std::vector<std::string> seeds;
  for (const MethodDescriptor* method : Methods()) {
    const std::unique_ptr<Message> request(
        MessageFactory::generated_factory()->GetPrototype(method->input_type())->New());
    FillIn(*request);
    seeds.push_back(Seed(method->name(), {request->SerializeAsString()}));
  }
  seeds.push_back(
      Seed("Ingest", {OpenMessage().SerializeAsString(), ScanMessage().SerializeAsString(),
                      CloseMessage().SerializeAsString()}));
  return seeds;
}

}  // namespace gem::fuzz
