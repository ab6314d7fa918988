#include "agent/cli/doctor/doctor.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <fstream>
#include <iostream>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "agent/cli/doctor/fixed_config.h"
#include "agent/cli/doctor/guesses.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/report/read_report.h"
#include "agent/config/loader.h"
#include "agent/config/source.h"
#include "agent/field/line_probe.h"
#include "agent/line_time.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"
#include "protocol/checklist.h"
#include "protocol/plc.h"
#include "protocol/value/unpack.h"
#include "protocol/value/word_order.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr int kHeld = 3;
constexpr int kDiffers = 4;
constexpr milliseconds kGuessTimeout{250};
constexpr milliseconds kPatience{2000};  // a device slower than its configured timeout is found
constexpr int kMeasurements = 5;
constexpr std::uint32_t kWordBits = 16;
constexpr std::array kParityWords{"none", "even", "odd"};  // the order of Parity

std::string quoted(const std::string& word) { return "\"" + word + "\""; }

std::string place_of(const LinkConfig& link) {
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel)) return serial->path;
  if (const auto* udp = std::get_if<UdpSettings>(&link.channel))
    return "udp " + udp->host + ":" + std::to_string(udp->port);
  const auto& tcp = std::get<TcpSettings>(link.channel);
  return tcp.host + ":" + std::to_string(tcp.port);
}

LineDefaults line_of(const SerialSettings& serial) {
  return {serial.baud, serial.data_bits, serial.parity, serial.stop_bits};
}

/// Returns the link with another speed and shape of the characters.
LinkConfig with_line(LinkConfig link, const LineDefaults& line) {
  auto& serial = std::get<SerialSettings>(link.channel);
  serial.baud = line.baud;
  serial.data_bits = line.data_bits;
  serial.parity = line.parity;
  serial.stop_bits = line.stop_bits;
  const int bits = 1 + line.data_bits + (line.parity == Parity::none ? 0 : 1) + line.stop_bits;
  link.char_time = std::chrono::nanoseconds(1'000'000'000LL * bits / line.baud);
  return link;
}

/// Returns the first question to a device; nullopt: none would be answered.
std::optional<Request> first_question(const Codec& codec) {
  if (codec.is_broadcast()) return std::nullopt;
  if (const PlcServices* plc = codec.plc()) return plc->run_state();
  return codec.presence();
}

/// Asks the first question after putting the receiver of the device into a known state.
ProbeAnswer greet(LineProbe& probe, const Codec& codec, milliseconds timeout) {
  if (const auto resync = codec.resync(); resync && codec.expects_reply(*resync)) {
    const ProbeAnswer ready = probe.ask(codec, *resync, timeout);
    if (!ready.is_answered()) return ready;
  }
  return probe.ask(codec, *first_question(codec), timeout);
}

bool is_there(const ProbeAnswer& answer, const Codec& codec) {
  return answer.is_answered() && !codec.is_from_gateway(answer.device_code);
}

class Doctor final {
 public:
  Doctor(const Config& config, std::string text) : config_(config), text_(std::move(text)) {}

  int run() {
    for (std::uint32_t i = 0; i < config_.links.size(); ++i) examine_link(i);
    for (const int status : {kFailed, kHeld, kDiffers})
      if (std::ranges::find(statuses_, status) != statuses_.end()) return status;
    return kDone;
  }
  const std::vector<KeyChange>& changes() const { return changes_; }

 private:
  void note(const std::string& text) { std::cout << "  " << text << '\n'; }
  void fault(int status, const std::string& text) {
    statuses_.push_back(status);
    note("FAULT: " + text);
  }
  void change(KeyChange change) {
    const auto pointer = pointer_of(text_, change);
    const std::string key = pointer ? *pointer : change.name + ": " + change.key;
    note("  config: " + key + " = " + change.value +
         (pointer ? "" : "  (change it by hand: a template or n makes this entry)"));
    changes_.push_back(std::move(change));
  }

  void examine_link(std::uint32_t index) {
    LinkConfig link = config_.links[index];
    std::cout << "link " << link.name << ", " << place_of(link) << '\n';
    const auto* serial = std::get_if<SerialSettings>(&link.channel);
    if (const auto holder = serial == nullptr ? std::nullopt : port_holder(serial->path)) {
      fault(kHeld, "another program uses the port: " + holder->program + ", pid " +
                       std::to_string(holder->pid) + ". End it, or correct the path.");
      return change({"links", link.name, "", "serial/path", quoted(serial->path)});
    }
    for (const DeviceConfig& device : config_.devices)
      if (device.link == index) examine_device(link, device);
  }

  /// Updates `link` if the device answers at another speed or parity.
  void examine_device(LinkConfig& link, const DeviceConfig& device) {
    std::cout << "device " << device.name << '\n';
    if (!first_question(*device.codec)) return note("a broadcast: no device answers");
    std::shared_ptr<const Codec> codec = device.codec;
    auto probe = std::make_unique<LineProbe>(link);
    if (const auto opened = probe->open(); !opened) return fault(kFailed, opened.error().text);
    ProbeAnswer answer = greet(*probe, *codec, std::max(kPatience, device.timeout));
    if (!is_there(answer, *codec)) {
      probe.reset();  // the port cannot be open twice
      if (!find_line(link, device) && !find_station(link, device, codec))
        return fault(kFailed, answer.text.empty() ? "no answer, whatever speed, parity or address"
                                                  : answer.text);
      probe = std::make_unique<LineProbe>(link);
      if (const auto opened = probe->open(); !opened) return fault(kFailed, opened.error().text);
      answer = greet(*probe, *codec, std::max(kPatience, device.timeout));
    }
    judge_echo(device, answer);
    judge_time(*probe, device, *codec);
    judge_model(*probe, device, codec);
    judge_state(*probe, *codec);
    judge_orders(*probe, device, *codec);
  }

  bool find_line(LinkConfig& link, const DeviceConfig& device) {
    const auto* serial = std::get_if<SerialSettings>(&link.channel);
    if (serial == nullptr) return false;
    const LineDefaults own = line_of(*serial);
    for (const LineDefaults& guess : line_guesses(*device.protocol, own)) {
      const LinkConfig other = with_line(link, guess);
      LineProbe probe(other);
      if (!probe.open() || !is_there(greet(probe, *device.codec, kGuessTimeout), *device.codec))
        continue;
      if (guess == own) return true;
      fault(kDiffers, "answers at " + to_string(guess) + ", not at " + to_string(own));
      const auto differs = [&](bool is, const std::string& key, const std::string& value) {
        if (is) change({"links", link.name, "", "serial/" + key, value});
      };
      differs(guess.baud != own.baud, "baud", std::to_string(guess.baud));
      differs(guess.data_bits != own.data_bits, "data_bits", std::to_string(guess.data_bits));
      differs(guess.parity != own.parity, "parity",
              quoted(kParityWords[static_cast<std::size_t>(guess.parity)]));
      differs(guess.stop_bits != own.stop_bits, "stop_bits", std::to_string(guess.stop_bits));
      link = other;
      return true;
    }
    return false;
  }

  /// Sets `codec` to that of the address which answers.
  bool find_station(const LinkConfig& link, const DeviceConfig& device,
                    std::shared_ptr<const Codec>& codec) {
    const std::string key(station_key(*device.protocol));
    const auto* own = option<std::int64_t>(*device.options, key);
    LineProbe probe(link);
    if (own == nullptr || !probe.open()) return false;
    for (const std::int64_t guess : station_guesses(*device.protocol, *own)) {
      const bool is_taken = std::ranges::any_of(config_.devices, [&](const DeviceConfig& other) {
        const auto* its = option<std::int64_t>(*other.options, key);
        return &other != &device && other.link == device.link && its != nullptr && *its == guess;
      });
      Options options = *device.options;
      options[key] = guess;
      const auto made = device.protocol->make(options);
      if (is_taken || !made || !is_there(greet(probe, **made, kGuessTimeout), **made)) continue;
      codec = *made;
      if (guess == *own) return true;
      fault(kDiffers, key + " " + std::to_string(guess) + " answers, and " + key + " " +
                          std::to_string(*own) + " does not");
      change({"devices", device.name, "", key, std::to_string(guess)});
      return true;
    }
    return false;
  }

  void judge_echo(const DeviceConfig& device, const ProbeAnswer& answer) {
    if (answer.echo == device.echo) return;
    fault(kDiffers, answer.echo ? "the line returns what is sent" : "the line does not echo");
    change({"devices", device.name, "", "echo", answer.echo ? "true" : "false"});
  }

  void judge_time(LineProbe& probe, const DeviceConfig& device, const Codec& codec) {
    milliseconds slowest{0};
    for (int i = 0; i < kMeasurements; ++i) {
      const auto answer =
          probe.ask(codec, *first_question(codec), std::max(kPatience, device.timeout));
      if (answer.is_answered()) slowest = std::max(slowest, answer.turnaround);
    }
    note("answers within " + std::to_string(slowest.count()) + " ms (timeout_ms " +
         std::to_string(device.timeout.count()) + ")");
    if (slowest < device.timeout) return;
    fault(kDiffers, "slower than its timeout");
    change({"devices", device.name, "", "timeout_ms", std::to_string(2 * slowest.count())});
  }

  /// Sets `codec` to that of the model which the device reports.
  void judge_model(LineProbe& probe, const DeviceConfig& device,
                   std::shared_ptr<const Codec>& codec) {
    const PlcServices* plc = codec->plc();
    if (plc == nullptr) return;
    std::vector<Bytes> images;
    for (const Request& question : plc->identify())
      images.push_back(probe.ask(*codec, question, std::max(kPatience, device.timeout)).image);
    const auto model = plc->model_from(images);
    if (!model) return note("model: not reported");
    note("model " + *model);
    const std::string configured = plc->model();
    if (*model == configured) return;
    if (!configured.empty()) {
      fault(kDiffers, "the config says " + configured);
      change({"devices", device.name, "", "model", quoted(*model)});
    }
    codec = plc->with_model(*model);
  }

  /// Returns the word at this address; nullopt if the model lacks it or it cannot be read.
  std::optional<std::uint64_t> word_at(LineProbe& probe, const Codec& codec,
                                       std::string_view name) {
    const auto address = codec.addresses().parse_address(name, std::nullopt);
    if (!address) return std::nullopt;
    const auto image = read(probe, codec, address->span);
    if (!image) return std::nullopt;
    return bits_at(*image, 0, address->span.bits);
  }

  /// Returns the image of the span, from its first bit on.
  std::optional<Bytes> read(LineProbe& probe, const Codec& codec, const Span& span) {
    for (const ReadWay& way : codec.addresses().read_ways(span.space)) {
      const std::uint32_t before = span.first_bit % way.align_bits;
      Span asked{span.space, span.first_bit - before, span.bits + before};
      asked.bits += (way.unit_bits - asked.bits % way.unit_bits) % way.unit_bits;
      const bool reaches = asked.first_bit >= way.first_bit && asked.end_bit() <= way.end_bit;
      if (way.gather != 0 || !reaches || asked.bits > way.max_bits) continue;
      const auto answer = probe.ask(codec, Read{asked, way.way}, kPatience);
      if (answer.kind != ProbeAnswer::Kind::data) return std::nullopt;
      return extract_bits(answer.image, before, span.bits);
    }
    return std::nullopt;
  }

  void judge_state(LineProbe& probe, const Codec& codec) {
    const PlcServices* plc = codec.plc();
    if (plc == nullptr) return;
    const auto state = probe.ask(codec, plc->run_state(), kPatience);
    if (const auto run = plc->run_state_from(state.image)) note(*run ? "RUN" : "STOP");
    for (const std::string_view name : {"M8005", "SM52"})
      if (const auto low = word_at(probe, codec, name))
        note(*low != 0 ? "battery low (" + std::string(name) + ")" : "battery good");
    for (const std::string_view name : {"D8004", "SD0"})
      if (const auto error = word_at(probe, codec, name); error && *error != 0)
        note("error word " + std::string(name) + " = " + std::to_string(*error));
    std::string clock;
    for (const std::string_view name : {"D8018", "D8017", "D8016", "D8015", "D8014", "D8013"})
      if (const auto part = word_at(probe, codec, name)) clock += " " + std::to_string(*part);
    if (!clock.empty()) note("clock (year month day hour minute second):" + clock);
  }

  void judge_orders(LineProbe& probe, const DeviceConfig& device, const Codec& codec) {
    for (const TagConfig& tag : device.tags) {
      const auto span = span_of(tag.point);
      if (!span || !has_word_order(tag.point) || span->bits != 2 * kWordBits) continue;
      const auto image = read(probe, codec, *span);
      if (!image) continue;
      const std::string name(std::string_view(tag.name));
      std::string values;
      for (const ByteOrder order :
           {ByteOrder::abcd, ByteOrder::cdab, ByteOrder::badc, ByteOrder::dcba}) {
        Point other = tag.point;
        other.order = order;
        if (const auto value = unpack(other, *image, span->first_bit))
          values += "  " + std::string(to_string(order)) + " " + value_text(*value, *no_units());
      }
      note(name + ":" + values);
      const auto order = likelier_order(tag.point, *image, span->first_bit);
      if (!order) continue;
      fault(kDiffers, "the word order of " + name + " is probably wrong");
      change({"devices", device.name, name, "word_order", quoted(std::string(to_string(*order)))});
    }
  }

  const Config& config_;
  const std::string text_;
  std::vector<int> statuses_;
  std::vector<KeyChange> changes_;
};

/// Writes the copy with the permissions of the config. Never replaces a file.
bool write_copy(const std::string& path, const std::string& config, const std::string& text) {
  struct stat permissions {};
  if (::stat(config.c_str(), &permissions) != 0) return false;
  const int file =
      ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, permissions.st_mode & 0777U);
  if (file < 0) return false;
  const bool is_written =
      ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  return ::close(file) == 0 && is_written;
}

}  // namespace

int run_doctor(const Config& config, const std::string& path, const DoctorQuestion& what) {
  log::set_level(log::Level::error);
  std::signal(SIGPIPE, SIG_IGN);
  const auto text = read_config_file(path);
  if (!text) return refused(path, text.error().front().text);
  Doctor doctor(config, *text);
  const int status = doctor.run();
  if (status == kDone) std::cout << "Nothing to change.\n";
  if (what.fix.empty() || doctor.changes().empty()) return status;
  const std::string fixed = fixed_config(*text, doctor.changes());
  if (const auto valid = config_of_file(path, fixed); !valid)
    return refused(what.fix,
                   "not written, the changed config is wrong: " + valid.error().front().text,
                   kFailed);
  if (!write_copy(what.fix, path, fixed))
    return refused(what.fix, "cannot be written: " + std::system_category().message(errno),
                   kFailed);
  std::cout << "Written: " << what.fix << ", without the comments of " << path << '\n';
  return status;
}

int run_scan(const std::string& port) {
  log::set_level(log::Level::error);
  if (const auto holder = port_holder(port))
    return refused(
        port,
        "another program uses it: " + holder->program + ", pid " + std::to_string(holder->pid),
        kHeld);
  struct Guess {
    const ProtocolInfo* protocol;
    LineDefaults line;
  };
  static constexpr std::size_t kFewStations = 4;
  std::vector<Guess> guesses;
  for (const ProtocolInfo& protocol : catalog())
    if (protocol.on_serial)
      for (const LineDefaults& line : line_guesses(protocol, protocol.line))
        guesses.push_back({&protocol, line});
  const auto stations_of = [](const ProtocolInfo& protocol) {
    const auto options = default_options(protocol);
    const auto* own = option<std::int64_t>(options, station_key(protocol));
    auto stations = station_guesses(protocol, own == nullptr ? 0 : *own);
    stations.resize(std::min(stations.size(), kFewStations));
    if (stations.empty()) stations.push_back(0);
    return stations;
  };
  std::chrono::nanoseconds most{0};
  for (const Guess& guess : guesses)
    // The characters of a question and of an answer, at most 40 of each.
    most += static_cast<int>(stations_of(*guess.protocol).size()) *
            (kGuessTimeout + std::chrono::nanoseconds(120LL * 12'000'000'000LL / guess.line.baud));
  std::cerr << "Nothing is written to a device. At most "
            << std::chrono::duration_cast<std::chrono::minutes>(most).count() + 1 << " minutes.\n";
  for (const Guess& guess : guesses) {
    std::cerr << guess.protocol->name << " at " << to_string(guess.line) << '\n';
    LinkConfig link;
    link.channel = SerialSettings{.path = port};
    link = with_line(link, guess.line);
    LineProbe probe(link);
    if (const auto opened = probe.open(); !opened) {
      if (&guess == guesses.data()) return refused("", opened.error().text, kFailed);
      continue;  // the adapter lacks this speed
    }
    const std::string key(station_key(*guess.protocol));
    for (const std::int64_t station : stations_of(*guess.protocol)) {
      Options options = default_options(*guess.protocol);
      if (!key.empty()) options[key] = station;
      const auto codec = guess.protocol->make(options);
      if (!codec || !is_there(greet(probe, **codec, kGuessTimeout), **codec)) continue;
      std::cout << "\"links\": [{\"name\": \"line1\", \"serial\": {\"path\": " << quoted(port)
                << ", \"baud\": " << guess.line.baud << ", \"data_bits\": " << guess.line.data_bits
                << ", \"parity\": "
                << quoted(kParityWords[static_cast<std::size_t>(guess.line.parity)])
                << ", \"stop_bits\": " << guess.line.stop_bits << "}}],\n"
                << "\"devices\": [{\"name\": \"plc1\", \"link\": \"line1\", \"protocol\": "
                << quoted(std::string(guess.protocol->name));
      if (!key.empty()) std::cout << ", " << quoted(key) << ": " << station;
      std::cout << "}]\n";
      return kDone;
    }
  }
  return refused(port, "nothing answers", kFailed);
}

}  // namespace fxagent
