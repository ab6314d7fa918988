// Opens arbitrary bytes as the store's file, as a worn-out card or another program may leave it.
// Nothing may crash or hang. Afterwards the store must work, with this file or with a fresh one
// next to it, and its rows must be publishable.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>

#include "agent/commands/result.h"
#include "agent/store/store.h"
#include "agent/uplink/payload/json_payload.h"

namespace {

namespace fs = std::filesystem;
using namespace fxagent;

constexpr std::int64_t kUtc = 1790000000000;
const StreamKey kStream{"press1", "fast"};
// CBOR of a sample without tags: time, number 7, boot "b", meta "m", no span, no flags.
const std::string kRow("\x86\x18\x64\x07\x61\x62\x61\x6D\xF6\x00", 10);

/// A directory in memory if the system has one, to avoid wearing out a disk. Removed at a normal
/// end of the program.
class Directory final {
 public:
  Directory() {
    const fs::path memory = "/dev/shm";
    std::string name = (fs::exists(memory) ? memory : fs::temp_directory_path()) / "fxagent-XXXXXX";
    if (mkdtemp(name.data()) == nullptr) std::abort();
    path_ = name;
  }
  ~Directory() {
    std::error_code gone;
    fs::remove_all(path_, gone);
  }
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;

  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

const fs::path& directory() {
  static const Directory made;
  return made.path();
}

bool any(const StreamKey&) { return true; }

/// Uses a store as the agent does at its start, and a while later.
void live_with(Store& store) {
  const std::vector<std::string> devices{"press1"};
  store.numbers().join(devices, kUtc);
  for (const KnownId& known : store.journal().known_ids())
    store.journal().find(known.device, known.id);
  for (const JournalEntry& entry : store.journal().unacknowledged()) {
    CommandResult result = recorded_result(entry.result);
    result.id = entry.id;
    if (!nlohmann::json::accept(result_text(result))) std::abort();
    store.journal().acknowledge(entry.device, entry.id, entry.number);
  }
  const Config config;
  JsonPayload payload(config, "9f3c21aa", "0.1.0");
  for (int i = 0; i < 4; ++i) {
    const auto stream = store.samples().streams().oldest_waiting(any);
    if (!stream) break;
    const auto message = payload.begin_history(4096);
    const auto batch = store.samples().next(*stream, *message);
    if (!batch) continue;
    if (!nlohmann::json::accept(message->take(*stream).at(0).payload)) std::abort();
    i % 2 == 0 ? static_cast<void>(store.samples().remove(*batch))
               : store.samples().returned(*batch);
  }
  store.upkeep(SteadyTime(std::chrono::seconds(1)), kUtc);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  for (const auto& left : fs::directory_iterator(directory())) fs::remove(left.path());
  std::ofstream(directory() / "fxagent.db", std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  StoreConfig config;
  config.path = directory().string();
  config.max_bytes = 1 << 20;
  {
    Store store(config, kUtc);
    live_with(store);
    std::vector<SampleRow> rows(1);
    rows[0].stream = kStream;
    rows[0].seq = 7;
    rows[0].content = kRow;
    // The disk works, so damage found while writing costs at most one attempt.
    if (!store.samples().append(rows, Store::Hold::no) &&
        !store.samples().append(rows, Store::Hold::no))
      std::abort();
    store.close();
  }
  Store again(config, kUtc);
  if (!again.is_writable()) std::abort();
  live_with(again);
  return 0;
}
