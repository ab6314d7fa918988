// fxhistory: stores the samples of agents in PostgreSQL, each exactly once. See
// docs/operate/history-database.md.
#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <fstream>
#include <map>
#include <stdexcept>
#include <string>

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
  std::string rest;
  if (url.starts_with("mqtt://"))
    rest = url.substr(7);
  else if (url.starts_with("mqtts://"))
    rest = url.substr(8);
  else
    throw CLI::ValidationError("--broker", "not mqtt://HOST:PORT or mqtts://HOST:PORT: " + url);
  if (rest.find_first_of("/@") != std::string::npos)  // the text may have a password
    throw CLI::ValidationError("--broker",
                               "must end after the port; user and password are --username and "
                               "--password-file");
  config.tls = url.starts_with("mqtts://");
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

/// Returns the first line of a file.
std::string secret(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line))
    throw CLI::ValidationError("--password-file", "cannot read " + path);
  return line;
}

std::string without_wildcards(const std::string& text) {
  const bool wrong = text.empty() || text.starts_with('$') || text.find_first_of("+#") != text.npos;
  return wrong ? "may not be empty, begin with $, or contain + or #: " + text : std::string();
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
      ->required();
  app.add_option("--client-id", subscriber.client_id,
                 "MQTT client id, a different one for each consumer, and always the same")
      ->required();
  app.add_option("--root", subscriber.root, "The root of the agents' configs")
      ->check(without_wildcards)
      ->capture_default_str();
  bool unshared = false;
  auto* group =
      app.add_option("--group", subscriber.group,
                     "Shared subscription. Each message goes to one consumer of the group")
          ->check(plain_name)
          ->capture_default_str();
  app.add_flag("--unshared", unshared,
               "Gets every message, whatever other consumers get. mosquitto 2.0.11 forgets shared "
               "subscriptions when it restarts, and keeps this one")
      ->excludes(group);
  app.add_option("--keep-days", config.keep_days, "Deletes older samples; 0 keeps all")
      ->check(CLI::Range(0, 36'500))
      ->capture_default_str();
  app.add_option("--receive-maximum", subscriber.receive_maximum, "Most messages of one commit")
      ->check(CLI::Range(1, 65'535))
      ->capture_default_str();
  app.add_option("--session-expiry-s", subscriber.session_expiry_s,
                 "Time for which the broker keeps messages while this consumer is away")
      ->capture_default_str();
  app.add_option("--synchronous-commit", config.commit,
                 "on; off is faster, and a crash of the database loses acknowledged samples")
      ->transform(CLI::CheckedTransformer(std::map<std::string, SynchronousCommit>{
          {"on", SynchronousCommit::on}, {"off", SynchronousCommit::off}}))
      ->default_str("on");
  app.add_option("--username", subscriber.username, "MQTT user");
  app.add_option("--password-file", password_file, "File with the MQTT password in its first line");
  app.add_option("--ca-file", subscriber.ca_file, "CA of the broker (the system's)");
  app.add_option("--cert-file", subscriber.cert_file, "Client certificate");
  app.add_option("--key-file", subscriber.key_file, "Key of the client certificate");
  try {
    app.parse(argc, argv);
    read_broker(broker, subscriber);
    if (unshared) subscriber.group.clear();
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
