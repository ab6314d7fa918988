#include "tests/sim/simulator.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <asio/co_spawn.hpp>
#include <asio/detached.hpp>
#include <asio/io_context.hpp>
#include <asio/local/stream_protocol.hpp>
#include <asio/post.hpp>
#include <asio/read_until.hpp>
#include <asio/redirect_error.hpp>
#include <asio/signal_set.hpp>
#include <asio/steady_timer.hpp>
#include <asio/use_awaitable.hpp>
#include <asio/write.hpp>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

#include "tests/sim/control.h"
#include "tests/sim/line.h"

namespace fxsim {
namespace {

using asio::redirect_error;
using asio::use_awaitable;
using asio::local::stream_protocol;
using nlohmann::json;

// Idle PLCs catch up with their scans this often, so the next request finds few of them due.
constexpr std::chrono::seconds kCatchUp{1};
// Deeds that are not commands, kept by all stations together.
constexpr std::size_t kQuestionsOfAll = 100'000;
constexpr std::size_t kMaxControlLine = 1U << 20U;

/// A thousand lines need more descriptors than the usual soft limit of 1,024.
void raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

}  // namespace

class Simulator::Parts final {
 public:
  Parts(const std::vector<PlcConfig>& plcs, Options options)
      : options_(std::move(options)), signals_(io_), lifetime_(io_), catch_up_(io_) {
    raise_descriptor_limit();
    std::signal(SIGPIPE, SIG_IGN);  // a closed client is reported as an error of write()
    if (!options_.log.empty()) {
      log_.open(options_.log, std::ios::app);
      if (!log_) throw std::system_error(errno, std::generic_category(), options_.log);
    }
    const auto questions_kept =
        std::clamp<std::size_t>(kQuestionsOfAll / plcs.size(), 1, Station::kQuestionsKept);
    for (const auto& plc : plcs) add(plc, questions_kept);
    for (const auto& place : places_)
      if (place.own_line) place.own_line->open();
    if (!options_.control.empty()) open_control();
    asio::co_spawn(io_, catch_up(), asio::detached);
  }

  ~Parts() { close(); }
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;

  std::string ready_line() const {
    auto plcs = nlohmann::ordered_json::array();
    for (const auto& place : places_) {
      nlohmann::ordered_json plc = {{"name", place.station->name()}};
      if (place.pty.empty()) {
        plc[place.udp ? "udp" : "tcp"] = place.line->port();
      } else {
        plc["pty"] = place.pty;
      }
      plcs.push_back(std::move(plc));
    }
    return nlohmann::ordered_json{{"ready", true}, {"plcs", std::move(plcs)}}.dump();
  }

  void run() {
    if (options_.signals == Signals::obeyed) {
      signals_.add(SIGINT);
      signals_.add(SIGTERM);
      signals_.async_wait([this](asio::error_code error, int) {
        if (!error) io_.stop();
      });
    }
    if (options_.lifetime) {
      lifetime_.expires_after(*options_.lifetime);
      lifetime_.async_wait([this](asio::error_code error) {
        if (!error) io_.stop();
      });
    }
    io_.run();
    close();
  }

  void stop() {
    asio::post(io_, [this] { io_.stop(); });
  }

 private:
  struct Place {
    std::unique_ptr<Station> station;
    std::unique_ptr<Line> own_line;  // null if the PLC shares an earlier PLC's line
    Line* line;
    std::string pty;
    bool udp;
  };

  void add(const PlcConfig& config, std::size_t questions_kept) {
    const auto start = Clock::now();
    Plc plc(*config.model, make_plant(config.plant), start);
    plc.set_run_switch(config.run_switch);
    plc.set_running(config.run);
    for (const auto& [device, value] : config.memory) plc.preset(device, value);
    Station::OnExchange on_exchange;
    if (log_.is_open())
      on_exchange = [this](const Exchange& exchange) {
        log_ << log_line(exchange).dump() << '\n' << std::flush;
      };
    auto station = std::make_unique<Station>(config.name, make_personality(config), std::move(plc),
                                             start, std::chrono::system_clock::now(),
                                             std::move(on_exchange), questions_kept);
    for (const auto& fault : config.faults) station->faults().add(fault);
    stations_[config.name] = station.get();
    std::unique_ptr<Line> own_line;
    if (config.line_of == places_.size()) own_line = std::make_unique<Line>(io_, config.line);
    auto* line = own_line ? own_line.get() : places_[config.line_of].line;
    line->attach(*station, config.response);
    places_.push_back({std::move(station), std::move(own_line), line, config.line.pty,
                       config.line.udp.has_value()});
  }

  void open_control() {
    // Removes the socket of an earlier run. If anything else has the path, bind() fails.
    std::error_code ignored;
    if (std::filesystem::is_socket(options_.control, ignored))
      std::filesystem::remove(options_.control, ignored);
    control_.emplace(io_, stream_protocol::endpoint(options_.control));
    asio::co_spawn(io_, accept_control(), asio::detached);
  }

  void close() {
    for (const auto& place : places_)
      if (place.own_line) place.own_line->close();
    if (control_) {
      control_.reset();
      std::error_code ignored;
      std::filesystem::remove(options_.control, ignored);
    }
  }

  asio::awaitable<void> catch_up() {
    for (;;) {
      asio::error_code error;
      catch_up_.expires_after(kCatchUp);
      co_await catch_up_.async_wait(redirect_error(use_awaitable, error));
      if (error) co_return;
      for (const auto& place : places_) place.station->plc().advance(Clock::now());
    }
  }

  asio::awaitable<void> accept_control() {
    for (;;) {
      asio::error_code error;
      auto socket = co_await control_->async_accept(redirect_error(use_awaitable, error));
      if (error) co_return;
      asio::co_spawn(io_, serve_control(std::move(socket)), asio::detached);
    }
  }

  asio::awaitable<void> serve_control(stream_protocol::socket socket) {
    std::string received;
    for (;;) {
      asio::error_code error;
      const auto size =
          co_await asio::async_read_until(socket, asio::dynamic_buffer(received, kMaxControlLine),
                                          '\n', redirect_error(use_awaitable, error));
      if (error) co_return;
      const auto request = json::parse(received.substr(0, size), nullptr, false);
      received.erase(0, size);
      const bool quit = request.is_object() && request.value("cmd", json()) == "quit";
      json reply = {{"ok", true}};
      if (request.is_discarded()) {
        reply = {{"ok", false}, {"error", "not JSON"}};
      } else if (!quit) {
        reply = obey(request, stations_, Clock::now());
      }
      const auto line = reply.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
      co_await asio::async_write(socket, asio::buffer(line), redirect_error(use_awaitable, error));
      if (quit) io_.stop();
      if (error) co_return;
    }
  }

  Options options_;
  std::ofstream log_;
  asio::io_context io_{1};
  asio::signal_set signals_;
  asio::steady_timer lifetime_;
  asio::steady_timer catch_up_;
  std::vector<Place> places_;
  Stations stations_;
  std::optional<stream_protocol::acceptor> control_;
};

Simulator::Simulator(const std::vector<PlcConfig>& plcs, Options options)
    : parts_(std::make_unique<Parts>(plcs, std::move(options))) {}

Simulator::~Simulator() = default;

std::string Simulator::ready_line() const { return parts_->ready_line(); }
void Simulator::run() { parts_->run(); }
void Simulator::stop() { parts_->stop(); }

}  // namespace fxsim
