#include "agent/log/log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <memory>
#include <mutex>
#include <vector>

#include "agent/log/log_repeats.h"
#include "agent/log/log_writer.h"
#include "agent/text.h"

namespace fxagent::log {
namespace {

using std::chrono::steady_clock;

constexpr std::size_t kMostValueBytes = 1024;
constexpr std::chrono::seconds kGoodbye{1};

/// Where lines end: at stderr, directly or by way of the writer.
class StderrSink final : public spdlog::sinks::sink {
 public:
  void log(const spdlog::details::log_msg& message) override {
    std::unique_lock lock(mutex_);
    const std::string text(message.payload.data(), message.payload.size());
    if (writer_ && !repeats_.take(steady_clock::now(), message.level, text)) return;
    const std::string line = line_of(message);
    if (!writer_) {
      std::fwrite(line.data(), 1, line.size(), stderr);
      return;
    }
    const std::shared_ptr<LogWriter> writer = writer_;
    lock.unlock();
    writer->write(line);
  }
  void flush() override {}
  void set_pattern(const std::string& pattern) override {
    set_formatter(std::make_unique<spdlog::pattern_formatter>(pattern));
  }
  void set_formatter(std::unique_ptr<spdlog::formatter> formatter) override {
    const std::lock_guard lock(mutex_);
    formatter_ = std::move(formatter);
  }

  void begin() {
    const auto writer = std::make_shared<LogWriter>(
        STDERR_FILENO, LogWriter::Callbacks{[this](std::uint64_t count) { return dropped(count); },
                                            [this] { return told(steady_clock::now()); }});
    const std::lock_guard lock(mutex_);
    writer_ = writer;
  }

  void end() {
    std::shared_ptr<LogWriter> writer;
    std::vector<std::string> rest = told(steady_clock::time_point::max());
    {
      const std::lock_guard lock(mutex_);
      writer = writer_;
    }
    if (!writer) return;
    for (std::string& line : rest) writer->write(std::move(line));
    // Nobody reads: lines that follow would stand where these do.
    if (!writer->flush(kGoodbye)) return;
    const std::lock_guard lock(mutex_);
    writer_.reset();
  }

 private:
  /// Under mutex_.
  std::string line_of(const spdlog::details::log_msg& message) {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    return {line.data(), line.size()};
  }

  std::string line_now(spdlog::level::level_enum level, const std::string& text) {
    return line_of({spdlog::string_view_t("fxagent"), level, spdlog::string_view_t(text)});
  }

  std::string dropped(std::uint64_t count) {
    const std::lock_guard lock(mutex_);
    return line_now(spdlog::level::warn,
                    format_line("log_lines_dropped", {{"count", std::to_string(count)}}));
  }

  /// The equal lines that were counted in whiles which are over now.
  std::vector<std::string> told(LogRepeats::Time now) {
    const std::lock_guard lock(mutex_);
    std::vector<std::string> lines;
    for (const LogRepeats::Repeated& repeated : repeats_.over(now))
      lines.push_back(line_now(static_cast<spdlog::level::level_enum>(repeated.level),
                               format_line("repeated", {{"count", std::to_string(repeated.count)},
                                                        {"line", repeated.text}})));
    return lines;
  }

  std::mutex mutex_;
  std::unique_ptr<spdlog::formatter> formatter_;
  LogRepeats repeats_;
  std::shared_ptr<LogWriter> writer_;  ///< shared with those who write through it at this moment
};

/// The one sink of the process: every room writes to the same stderr, so lines must not mix. It is
/// never destroyed: the writer's thread may outlive everything.
StderrSink& sink() {
  static StderrSink& instance = *new StderrSink;
  return instance;
}

spdlog::logger& logger() {
  static spdlog::logger& instance = [&]() -> spdlog::logger& {
    const std::shared_ptr<StderrSink> shared(&sink(), [](StderrSink*) {});
    auto* made = new spdlog::logger("fxagent", shared);
    made->set_formatter(std::make_unique<spdlog::pattern_formatter>(
        "%Y-%m-%dT%H:%M:%S.%eZ %l %v", spdlog::pattern_time_type::utc));
    return *made;
  }();
  return instance;
}

std::terminate_handler say_why = nullptr;

void write_and_end() {
  sink().end();
  say_why();
}

/// A character of UTF-8 that would be cut in two is left out. Ours: utfcpp steps back over whole
/// characters of valid text only.
std::string shortened(std::string_view text, std::size_t most) {
  if (text.size() <= most) return std::string(text);
  std::size_t length = most;
  while (length > most - 3 && (static_cast<unsigned char>(text[length]) & 0xC0) == 0x80) --length;
  return std::string(text.substr(0, length)) + "… (" + std::to_string(text.size()) + " bytes)";
}

void write(spdlog::level::level_enum level, std::string_view event,
           std::initializer_list<Field> fields) {
  if (!logger().should_log(level)) return;
  logger().log(level, spdlog::string_view_t(format_line(event, fields)));
}

}  // namespace

std::string excerpt(std::string_view foreign) { return shortened(foreign, kMostForeignBytes); }

std::string format_line(std::string_view event, std::initializer_list<Field> fields) {
  std::string line(event);
  for (const auto& [key, given] : fields) {
    const std::string value = shortened(given, kMostValueBytes);
    line += ' ';
    line += key;
    line += '=';
    const std::string shown = escaped(value, Escape::log);
    if (!shown.empty() && shown == value && shown.find_first_of(" =") == std::string::npos)
      line += shown;
    else
      line.append("\"").append(shown).append("\"");
  }
  return line;
}

InBackground::InBackground() {
  logger();
  sink().begin();
  if (say_why == nullptr) say_why = std::set_terminate(write_and_end);
}

InBackground::~InBackground() { sink().end(); }

void set_level(Level level) {
  switch (level) {
    case Level::debug:
      return logger().set_level(spdlog::level::debug);
    case Level::info:
      return logger().set_level(spdlog::level::info);
    case Level::warn:
      return logger().set_level(spdlog::level::warn);
    case Level::error:
      return logger().set_level(spdlog::level::err);
  }
}

void debug(std::string_view event, std::initializer_list<Field> fields) {
  write(spdlog::level::debug, event, fields);
}
void info(std::string_view event, std::initializer_list<Field> fields) {
  write(spdlog::level::info, event, fields);
}
void warn(std::string_view event, std::initializer_list<Field> fields) {
  write(spdlog::level::warn, event, fields);
}
void error(std::string_view event, std::initializer_list<Field> fields) {
  write(spdlog::level::err, event, fields);
}

}  // namespace fxagent::log
