// Servos on a pseudo-terminal whose packets are ROBOTIS' own (Dynamixel2Arduino: Slave and protocol.cpp): framing, CRC,
// stuffing, pings, status packets. What the control table means, the shafts and the faults are written here.
//
//   robotis_bus LINK FIRMWARE POSITIONS LOG
//
// POSITIONS: of the shafts from tick 2048 [rad], separated by commas; ids from 1. LOG: time and all positions, a line
// every 4 ms. A line on standard input is a fault, as of `python -m tests.emulators bus`. Servos have no Fast Sync Read.
#include "utility/slave.h"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

using Bytes = std::vector<uint8_t>;

DXLPortHandler::DXLPortHandler() : open_state_(true) {}
bool DXLPortHandler::getOpenState() { return open_state_; }
void DXLPortHandler::setOpenState(bool open) { open_state_ = open; }

namespace {

constexpr double kTick = 2 * M_PI / 4096, kSpeedUnit = 0.229 * 2 * M_PI / 60, kLag = 0.02;
constexpr int kTorque = 64, kStatusReturn = 68, kError = 70, kWatchdog = 98, kGoalCurrent = 102, kGoal = 116;
constexpr int kClock = 120, kSpeed = 128, kPosition = 132, kIndirect = 168, kIndirectData = 224, kIndirects = 28;
constexpr int kTripped = 255, kRange = 4, kAccess = 7;

double now() {
  timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec + 1e-9 * time.tv_nsec;
}

struct Wire : DXLPortHandler {
  Bytes in, out;
  size_t next = 0;
  void begin() override {}
  void end() override {}
  int available() override { return in.size() - next; }
  int read() override { return in[next++]; }
  size_t write(uint8_t byte) override { return out.push_back(byte), 1; }
  size_t write(uint8_t* bytes, size_t count) override { return out.insert(out.end(), bytes, bytes + count), count; }
};

class Servo : public DYNAMIXEL::Slave {
 public:
  Servo(int id, double position, int firmware) : Slave(1120, 2.0), position(position), goal_(position), firmware_(firmware) {
    setPort(wire_);
    setID(id);
    setFirmwareVersion(firmware);
    put(38, 2, 2047), put(8, 1, 3), put(9, 1, 250), put(11, 1, 3), put(63, 1, 52), put(48, 4, 4095);
    put(0, 2, 1120), put(6, 1, firmware), put(7, 1, id);
    restart();
  }

  void restart() {
    std::fill(table_ + kTorque, table_ + 256, 0);
    put(kStatusReturn, 1, 2), put(84, 2, 800), put(kGoalCurrent, 2, 2047);
    for (int k = 0; k < kIndirects; ++k) put(kIndirect + 2 * k, 2, kIndirectData + k);
    began_ = heard = now();
  }

  void move(double seconds) {
    const int watch = get(kWatchdog, 1);
    if (get(kTorque, 1) && watch && watch != kTripped && now() - heard > 0.02 * watch) {
      put(kWatchdog, 1, kTripped);
      goal_ = position;
    }
    double way = 0;
    if (get(kTorque, 1) && !jammed) way = (goal_ - position) * std::min(1.0, seconds / kLag);
    position += way;
    if (jammed && get(kTorque, 1) && std::abs(goal_ - position) > 0.05) put(kError, 1, 0x20), put(kTorque, 1, 0);
    if (stale) return;
    put(kSpeed, 4, std::lround(way / seconds / kSpeedUnit));
    put(kPosition, 4, std::lround(2048 + (position + shift) / kTick));
    put(kClock, 2, int64_t(1e3 * (now() - began_)) % 32768);
  }

  Bytes status(uint8_t error, Bytes data) {
    wire_.out.clear();
    txStatusPacket(getID(), error | alert(), data.empty() ? nullptr : data.data(), data.size());
    return wire_.out;
  }

  // All that a servo answers to a packet for it alone, as ROBOTIS' code has it.
  Bytes answer(const Bytes& packet, const Bytes& parameters) {
    wire_.in = packet, wire_.next = 0, wire_.out.clear(), parameters_ = parameters;
    processPacket();
    return wire_.out;
  }

  Bytes read(int address, int size) {
    Bytes data(size);
    for (int k = 0; k < size; ++k) {
      int place = address + k - kIndirectData;
      data[k] = table_[(place >= 0 && place < kIndirects ? get(kIndirect + 2 * place, 2) : address + k) & 255];
    }
    return data;
  }

  uint8_t write(int address, const uint8_t* data, int size) {
    if ((address < kTorque && get(kTorque, 1)) || (address == kTorque && data[0] && get(kError, 1))) return kAccess;
    if (get(kWatchdog, 1) == kTripped && address >= 100 && address <= kGoal) return kRange;
    if (address + size > 256) return kAccess;
    std::copy(data, data + size, table_ + address);
    if (address == kGoal) goal_ = (get(kGoal, 4) - 2048) * kTick;
    return 0;
  }

  uint8_t level() { return get(kStatusReturn, 1); }
  void put(int address, int size, int64_t value) {
    for (int k = 0; k < size; ++k) table_[address + k] = value >> 8 * k;
  }

  double position, heard = 0, shift = 0;
  bool silent = false, jammed = false, stale = false;

 private:
  int64_t get(int address, int size) {
    uint32_t value = 0;
    for (int k = 0; k < size; ++k) value |= uint32_t(table_[address + k]) << 8 * k;
    return size == 4 ? int32_t(value) : int64_t(value);
  }
  uint8_t alert() { return get(kError, 1) ? 0x80 : 0; }

  bool processInstRead() override {
    if (!level()) return true;
    Bytes data = read(parameters_[0] | parameters_[1] << 8, parameters_[2] | parameters_[3] << 8);
    return txStatusPacket(getID(), alert(), data.data(), data.size());
  }

  bool processInstWrite() override {
    uint8_t error = write(parameters_[0] | parameters_[1] << 8, parameters_.data() + 2, parameters_.size() - 2);
    return level() < 2 || txStatusPacket(getID(), error | alert(), nullptr, 0);
  }

  Wire wire_;
  Bytes parameters_;
  uint8_t table_[512] = {0};
  double goal_, began_ = 0;
  int firmware_;
};

class Bus {
 public:
  Bus(const char* link, int firmware, const char* positions, const char* log) : log_(log) {
    std::stringstream list(positions);
    for (std::string each; std::getline(list, each, ',');)
      servos_.push_back(std::make_unique<Servo>(servos_.size() + 1, std::stod(each), firmware));
    openpty(&master_, &slave_, nullptr, nullptr, nullptr);
    termios settings;
    tcgetattr(master_, &settings), cfmakeraw(&settings), tcsetattr(master_, TCSANOW, &settings);
    fcntl(master_, F_SETFL, O_NONBLOCK);
    unlink(link);
    if (symlink(ttyname(slave_), link)) exit(1);
    begin_parse_dxl_packet(&parsed_, 2, buffer_, sizeof buffer_);
  }

  void run() {
    fcntl(0, F_SETFL, O_NONBLOCK);
    double last = now();
    for (;;) {
      pollfd ends[2] = {{master_, POLLIN, 0}, {0, POLLIN, 0}};
      poll(ends, 2, 2);
      if (ends[1].revents && !command()) return;
      double time = now();
      if (time - last > 1e-4) {
        for (auto& servo : servos_) servo->move(time - last);
        last = time;
      }
      if (time - logged_ > 4e-3) write_log(time);
      if (master_ < 0 || !(ends[0].revents & POLLIN)) continue;
      uint8_t bytes[4096];
      ssize_t count = ::read(master_, bytes, sizeof bytes);
      if (count <= 0) continue;
      if (echo_) send(Bytes(bytes, bytes + count));
      for (ssize_t k = 0; k < count; ++k) heard(bytes[k]);
    }
  }

 private:
  void heard(uint8_t byte) {
    packet_.push_back(byte);
    auto result = parse_dxl_packet(&parsed_, byte);
    if (result == DXL_LIB_PROCEEDING) return;
    if (result == DXL_LIB_OK && parsed_.inst_idx != DXL_INST_STATUS) {
      Bytes parameters(parsed_.p_param_buf, parsed_.p_param_buf + parsed_.recv_param_len);
      for (auto& servo : servos_) servo->heard = now();
      Bytes answer = answered(parameters);
      if (!answer.empty()) {
        if (delay_) usleep(100000);
        if (garbage_) {
          Bytes noise(64);
          for (auto& each : noise) each = rand();
          send(noise);
        }
        send(answer);
      }
    }
    packet_.clear();
    begin_parse_dxl_packet(&parsed_, 2, buffer_, sizeof buffer_);
  }

  Bytes answered(const Bytes& given) {
    Bytes all;
    const bool reads = parsed_.inst_idx == DXL_INST_SYNC_READ, writes = parsed_.inst_idx == DXL_INST_SYNC_WRITE;
    if (!reads && !writes) {
      for (auto& servo : servos_) {
        if (servo->silent || parsed_.id != servo->getID()) continue;
        if (parsed_.inst_idx == DXL_INST_REBOOT) {
          servo->restart();
          return servo->status(0, {});
        }
        Bytes one = servo->answer(packet_, given);
        all.insert(all.end(), one.begin(), one.end());
      }
      return all;
    }
    if (given.size() < 4) return all;
    const int address = given[0] | given[1] << 8, size = given[2] | given[3] << 8, step = reads ? 1 : 1 + size;
    for (size_t place = 4; place + step <= given.size(); place += step) {
      Servo* servo = given[place] >= 1 && given[place] <= servos_.size() ? servos_[given[place] - 1].get() : nullptr;
      if (writes && servo && !servo->silent) servo->write(address, &given[place + 1], size);
      if (!reads) continue;
      if (!servo || servo->silent || !servo->level()) break;  // each waits for the one before it
      Bytes one = servo->status(0, servo->read(address, size));
      all.insert(all.end(), one.begin(), one.end());
    }
    return all;
  }

  void send(const Bytes& bytes) {
    if (master_ >= 0 && ::write(master_, bytes.data(), bytes.size()) < 0) return;
  }

  bool command() {
    char text[256];
    ssize_t count = ::read(0, text, 255);
    if (count <= 0) return count < 0;
    std::string line(text, std::find(text, text + count, '\n'));
    auto is = [&](const char* kind) { return line.rfind(kind, 0) == 0; };
    const size_t space = line.find_last_of(' ');
    const int id = space == std::string::npos ? 0 : atoi(line.c_str() + space);
    Servo& servo = *servos_[std::clamp(id, 1, int(servos_.size())) - 1];
    if (is("silent servo")) servo.silent = true;
    if (is("overload")) servo.jammed = true;
    if (is("stale values")) servo.stale = true;
    if (is("jumping values")) servo.shift = 0.6;
    if (is("reboot")) servo.restart();
    if (is("delay")) delay_ = true;
    if (is("garbage")) garbage_ = true;
    if (is("echo")) echo_ = true;
    if (is("status return"))
      for (auto& each : servos_) each->put(kStatusReturn, 1, id);
    if (is("power loss"))
      for (auto& each : servos_) each->silent = true, each->restart();
    if (is("cable pulled")) close(master_), close(slave_), master_ = -1;
    return true;
  }

  void write_log(double time) {
    logged_ = time;
    char text[32];
    snprintf(text, sizeof text, "%.4f", time);
    log_ << text;
    for (auto& servo : servos_) log_ << ' ' << servo->position;
    log_ << std::endl;
  }

  std::vector<std::unique_ptr<Servo>> servos_;
  std::ofstream log_;
  int master_ = -1, slave_ = -1;
  double logged_ = 0;
  bool echo_ = false, garbage_ = false, delay_ = false;
  InfoToParseDXLPacket_t parsed_;
  uint8_t buffer_[2048];
  Bytes packet_;
};

}  // namespace

int main(int count, char** given) {
  if (count != 5) return 2;
  Bus(given[1], atoi(given[2]), given[3], given[4]).run();
}
