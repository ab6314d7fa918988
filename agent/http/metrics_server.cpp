#include "agent/http/metrics_server.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>

#include "agent/http/exposition.h"
#include "agent/http/listening_socket.h"
#include "agent/http/probe.h"
#include "agent/log/log.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr const char* kExposition = "text/plain; version=0.0.4; charset=utf-8";
constexpr unsigned kOk = 200;
constexpr unsigned kNotFound = 404;
constexpr unsigned kUnavailable = 503;

constexpr const char* kNote = "the agent continues without metrics";

HttpAnswer answer_of(Probe probe) {
  return {probe.good ? kOk : kUnavailable, kJson,
          std::make_shared<const std::string>(std::move(probe.json))};
}

}  // namespace

MetricsServer::MetricsServer(MetricsConfig config, StatusBoard& board)
    : config_(std::move(config)), board_(board), end_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  try {
    if (end_ < 0) throw std::system_error(errno, std::generic_category(), "no eventfd");
    const WithoutSignals quiet;
    thread_ = std::thread([this] { work(); });
  } catch (const std::system_error& error) {
    log::error("metrics", {{"state", "down"}, {"reason", error.what()}, {"note", kNote}});
  }
}

MetricsServer::~MetricsServer() {
  if (thread_.joinable()) {
    ::eventfd_write(end_, 1);
    thread_.join();
  }
  if (end_ >= 0) ::close(end_);
}

void MetricsServer::work() {
  std::string told;
  while (true) {
    if (const auto server = started(told)) return serve(*server);
    if (!wait(-1, Clock::now() + kRetry)) return;
  }
}

std::unique_ptr<HttpServer> MetricsServer::started(std::string& told) {
  auto socket = ListeningSocket::open(config_);
  std::string address = socket ? socket->address() : "";
  auto server = std::move(socket).and_then([this](ListeningSocket&& listening) {
    return HttpServer::start(std::move(listening),
                             [this](std::string_view path) { return answer(path); });
  });
  if (server) {
    log::info("metrics", {{"state", "listening"}, {"listen", address}});
    return std::move(*server);
  }
  if (server.error().text != told) {
    told = server.error().text;
    log::error(
        "metrics",
        {{"state", "down"}, {"reason", told}, {"note", std::string(kNote) + ", and tries again"}});
  }
  return nullptr;
}

void MetricsServer::serve(HttpServer& server) {
  server_ = &server;
  while (wait(server.file(), server.run(Clock::now()))) {
  }
}

bool MetricsServer::wait(int file, SteadyTime until) const {
  const auto left = std::chrono::ceil<milliseconds>(until - Clock::now());
  const int timeout =
      until == SteadyTime::max()
          ? -1
          : static_cast<int>(std::clamp(left, milliseconds(0), milliseconds(60'000)).count());
  std::array<pollfd, 2> files{pollfd{end_, POLLIN, 0}, pollfd{file, POLLIN, 0}};
  ::poll(files.data(), files.size(), timeout);
  return files[0].revents == 0;
}

HttpAnswer MetricsServer::answer(std::string_view path) {
  if (path == "/metrics") return metrics();
  if (path == "/healthz") return answer_of(health_of(status().get(), Clock::now()));
  if (path == "/readyz") return answer_of(readiness_of(status().get(), Clock::now()));
  static const auto none = std::make_shared<const std::string>(
      "{\"error\":\"there are /metrics, /healthz and /readyz\"}\n");
  return {kNotFound, kJson, none};
}

HttpAnswer MetricsServer::metrics() {
  const auto now_here = status();
  // Old numbers would look like new ones.
  if (is_stale(now_here.get(), Clock::now()))
    return answer_of(health_of(now_here.get(), Clock::now()));
  if (now_here != shown_) {
    text_ = std::make_shared<const std::string>(exposition(*now_here, server_->closed()));
    shown_ = now_here;
  }
  return {kOk, kExposition, text_};
}

std::shared_ptr<const AgentStatus> MetricsServer::status() {
  const auto now = Clock::now();
  const auto patience = now < ask_again_ ? milliseconds(0) : kPatience;
  auto newest = board_.read(now, patience);
  if (patience > milliseconds(0) && Clock::now() - now >= kPatience)
    ask_again_ = Clock::now() + StatusBoard::kFresh;
  return newest;
}

}  // namespace fxagent
