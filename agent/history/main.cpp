// fxhistory: stores the samples of agents in PostgreSQL, each exactly once. See
// docs/operate/history-database.md.
#include <CLI/CLI.hpp>
#include <cerrno>
#include <csignal>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>
#include <system_error>

#include "agent/history/consumer.h"
#include "agent/log/log.h"
#include "agent/without_signals.h"

namespace {

using namespace fxagent;
using namespace fxagent::history;

constexpr int kFailedToStart = 1;
constexpr int kWrongCall = 2;

/// Splits mqtt://HOST[:PORT] or mqtts://HOST[:PORT]. An IPv6 address is in brackets.
void read_broker(const std::string& url, SubscriberConfig& config) {
  config.tls = url.starts_with("mqtts://");
  if (!config.tls && !url.starts_with("mqtt://"))
    throw CLI::ValidationError("--broker", "not mqtt://HOST:PORT or mqtts://HOST:PORT: " + url);
  std::string rest = url.substr(url.find("://") + 3);
  if (rest.find_first_of("/@") != std::string::npos)  // the text may have a password
    throw CLI::ValidationError("--broker",
                               "must end after the port; user and password are --username and "
                               "--password-file");
  config.port = config.tls ? 8883 : 1883;
  const std::size_t bracket = rest.rfind(']');
  const std::size_t colon = rest.rfind(':');
  if (colon != std::string::npos && (bracket == std::string::npos || colon > bracket)) {
    const std::string port = rest.substr(colon + 1);
    if (!CLI::detail::lexical_cast(port, config.port) || config.port < 1 || config.port > 65535)
      throw CLI::ValidationError("--broker", "the port is not 1 to 65535: " + url);
    rest.resize(colon);
  }
  if (rest.starts_with('[') && rest.ends_with(']')) rest = rest.substr(1, rest.size() - 2);
  if (rest.empty()) throw CLI::ValidationError("--broker", "no host: " + url);
  config.host = rest;
}

/// Returns the first line of the password file.
std::string secret(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line) || line.empty())
    throw CLI::ValidationError("--password-file", path + ": the first line is empty");
  return line;
}

std::string on_or_off(const std::string& text) {
  return text == "on" || text == "off" ? std::string() : "must be on or off: " + text;
}

std::string without_wildcards(const std::string& text) {
  const bool wrong = text.empty() || text.starts_with('$') || text.find_first_of("+#") != text.npos;
  return wrong ? "may not be empty, begin with $, or contain + or #: " + text : std::string();
}

std::string not_empty(const std::string& text) {
  return text.empty() ? "may not be empty" : std::string();
}

std::string readable_file(const std::string& path) {
  errno = 0;
  std::ifstream file(path);
  if (file) file.peek();  // a directory opens, and cannot be read
  if (file) return {};
  return path + ": " + (errno == 0 ? "the file is empty" : std::generic_category().message(errno));
}

std::string plain_name(const std::string& text) {
  return text.empty() || text.find_first_of("/+#") != text.npos
             ? "may not be empty or contain /, + or #: " + text
             : std::string();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Stores the samples of agents in PostgreSQL, each exactly once. Runs until SIGTERM."};
  ConsumerConfig config;
  SubscriberConfig& subscriber = config.subscriber;
  std::string broker = "mqtt://127.0.0.1:1883";
  std::string password_file;
  app.add_option("--broker", broker, "mqtt://HOST:PORT or mqtts://HOST:PORT")
      ->capture_default_str();
  app.add_option("--database", config.database,
                 "Connection string of libpq: \"host=/run/postgresql dbname=history\"")
      ->check(fault_of_target)
      ->required();
  app.add_option("--client-id", subscriber.client_id,
                 "MQTT client id, a different one for each consumer, and always the same")
      ->check(not_empty)
      ->required();
  app.add_option("--root", subscriber.root, "The root of the agents' configs")
      ->check(without_wildcards)
      ->capture_default_str();
  app.add_option("--group", subscriber.group,
                 "Shares the messages with the consumers of this name: each message goes to one of "
                 "them, also to an absent one. Without it, this consumer gets every message")
      ->check(plain_name);
  app.add_option("--keep-days", config.keep_days, "Deletes older samples; 0 keeps all")
      ->check(CLI::Range(0, 36'500))
      ->capture_default_str();
  app.add_option("--receive-maximum", subscriber.receive_maximum, "Most messages of one commit")
      ->check(CLI::Range(1, 65'535))
      ->capture_default_str();
  app.add_option("--session-expiry-s", subscriber.session_expiry_s,
                 "Time for which the broker keeps messages while this consumer is away")
      ->capture_default_str();
  app.add_option("--keep-alive-s", subscriber.keep_alive_s,
                 "The broker drops this consumer after 1.5 times this silence")
      ->check(CLI::Range(5, 65'535))
      ->capture_default_str();
  std::string commit = "on";
  app.add_option("--synchronous-commit", commit,
                 "on; off is faster, and a crash of the database loses acknowledged samples")
      ->check(on_or_off)
      ->capture_default_str();
  auto* username = app.add_option("--username", subscriber.username, "MQTT user");
  app.add_option("--password-file", password_file, "File with the MQTT password in its first line")
      ->check(readable_file)
      ->needs(username);
  app.add_option("--ca-file", subscriber.ca_file, "CA of the broker (the system's)")
      ->check(readable_file);
  auto* certificate = app.add_option("--cert-file", subscriber.cert_file, "Client certificate");
  auto* key = app.add_option("--key-file", subscriber.key_file, "Key of the client certificate");
  certificate->check(readable_file)->needs(key);
  key->check(readable_file)->needs(certificate);
  app.set_version_flag("--version", FXAGENT_VERSION);
  try {
    app.parse(argc, argv);
    read_broker(broker, subscriber);
    config.commit = commit == "on" ? SynchronousCommit::on : SynchronousCommit::off;
    const bool has_files = !subscriber.ca_file.empty() || !subscriber.cert_file.empty();
    if (has_files && !subscriber.tls)
      throw CLI::ValidationError("--broker", "--ca-file and --cert-file need mqtts://");
    if (!password_file.empty()) subscriber.password = secret(password_file);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongCall;
  }
  try {
    std::signal(SIGPIPE, SIG_IGN);
    const int stop = stop_descriptor();
    if (stop < 0) throw std::runtime_error("no free file handle");
    Consumer(config, stop).run();
  } catch (const std::exception& error) {
    log::say(log::Level::error, "fxhistory", std::string("fxhistory: ") + error.what());
    return kFailedToStart;
  }
  return 0;
}
